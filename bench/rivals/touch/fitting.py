"""The papers' networks by name."""

from collections.abc import Callable, Mapping
from typing import Any

from bench.rivals.touch import deformation_network, image_network
from bench.rivals.touch.deformation_network import DeformationNetwork, fit_deformation_network
from bench.rivals.touch.image_network import ImageNetwork, fit_image_network
from objectfolder.errors import InputError
from objectfolder.products.store import Product

TouchRival = ImageNetwork | DeformationNetwork
RIVALS: Mapping[str, Callable[..., TouchRival]] = {
    image_network.NAME: fit_image_network,
    deformation_network.NAME: fit_deformation_network,
}


def fit_touch_rival(name: str, touches: Product, **options: Any) -> TouchRival:
    """Fit the network `name` of `RIVALS`; both answer `render(points, depth_m, tilt_deg, azimuth_deg)`.

    Parameters
    ----------
    name
        ``"ObjectFolder 1.0"`` or ``"ObjectFolder 2.0"``.
    touches
        Product of `touches.simulate_touches`.
    options
        As of `image_network.fit_image_network`.

    Raises
    ------
    InputError
        A name that is not known, nothing to train on, or neither steps nor a budget.
    """
    if name not in RIVALS:
        raise InputError("touch network", f"unknown name {name!r}", f"Use one of {sorted(RIVALS)}.")
    return RIVALS[name](touches, **options)
