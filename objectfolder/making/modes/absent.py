"""The product of an object without sound: no modes, and the reason."""

from typing import Any

import numpy as np

from objectfolder.products.store import Array, Product

LEFT_OUT = "left out by choice (column senses)"

_OF_MODES = {
    "frequencies_hz": "Hz",
    "eigenvalues": "rad2 s-2",
    "dampings_per_s": "s-1",
    "residuals": "1",
    "error_estimates_cents": "cents",
    "radiation_weights": "kg-1/2",
}


def absent_modes(reason: str) -> Product:
    """Return what `simulate_modes` returns, without a mode or a point: of a sense that is not there.

    The object keeps its other senses; what reads the modes says the reason instead of a sound.

    Parameters
    ----------
    reason
        Why there is no sound, in a few words: attribute ``absent``, and a warning.

    Examples
    --------
    >>> modes = absent_modes("no solid came of filling it")
    >>> modes.attributes["warnings"], modes["mode_shapes"].shape
    (['it has no sound: no solid came of filling it'], (0, 3, 0))
    """
    arrays = {name: Array(np.zeros(0), ("mode",), unit, "of no mode") for name, unit in _OF_MODES.items()}
    for name in ("points", "normals"):
        arrays[name] = Array(np.zeros((0, 3)), ("point", "axis"), "m", "of no point", False)
    shapes = np.zeros((0, 3, 0), dtype=np.float32)
    arrays["mode_shapes"] = Array(shapes, ("point", "axis", "mode"), "kg-1/2", "of no mode", False)
    arrays["held_out"] = Array(np.zeros(0, dtype=bool), ("point",), "1", "point is not for fitting")
    rigid = ("volume_m3", "mass_kg", "centre_of_mass_m", "inertia_kg_m2")
    unknown = (*rigid, "error_estimate_cents", "geometry_error_estimate_cents")
    attributes: dict[str, Any] = {
        "absent": reason,
        "audible": False,
        "stated_frequency_limit_hz": 0.0,
        "count_certificate": {},
        "discretisation": {},
        "warnings": [f"it has no sound: {reason}"],
        **dict.fromkeys(unknown),
    }
    return Product(arrays, attributes)
