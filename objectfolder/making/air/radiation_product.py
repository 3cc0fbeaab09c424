"""What modes radiate, as arrays of their product."""

import numpy as np

from objectfolder.audio.air.multipoles import Radiation
from objectfolder.products.store import Array, Product


def radiation_arrays(radiation: Radiation) -> dict[str, Array]:
    """Arrays of a product, its attribute ``transfer`` being the rest; see `radiation_of`."""
    parts = np.stack([radiation.multipoles.real, radiation.multipoles.imag], axis=2).astype(np.float32)
    return {
        "multipoles": Array(
            parts, ("mode", "multipole", "part"), "Pa s m-1 kg-1/2", "real and imaginary part"
        ),
        "transfer_wavenumbers": Array(radiation.wavenumbers, ("mode",), "m-1", "of the air, 0: not solved"),
        "transfer_residuals": Array(
            radiation.residuals,
            ("mode",),
            "1",
            "estimated relative error of the far field, rms over directions",
        ),
    }


def radiation_of(modes: Product) -> Radiation | None:
    """Return what a product of modes says of the air; None where it says nothing."""
    described = modes.attributes.get("transfer")
    if described is None:
        return None
    parts = modes["multipoles"].astype(np.float64)
    return Radiation(
        np.array(described["centre_m"]),
        float(described["radius_m"]),
        np.array(modes["transfer_wavenumbers"]),
        parts[..., 0] + 1j * parts[..., 1],
        np.array(modes["transfer_residuals"]),
    )
