"""What a thin wall of glass reflects, lets through and absorbs: a slab whose faces reflect into one another.

Rays go straight on. At both faces light is reflected as by a smooth dielectric, and inside it is absorbed on
its refracted way. All orders of reflection are summed as intensities, for walls are not thin to light waves.
With Fresnel's reflectance R of a face and a the share that one passage lets through,

    transmittance = (1 - R)^2 a / (1 - R^2 a^2)        reflectance = R (1 + a transmittance)

(Born and Wolf, Principles of Optics, 7th ed., 1999, section 7.6, without phases). Clear glass reflects
2R / (1 + R).
"""

import math

import numpy as np

from objectfolder.vision.network.directional_albedo import dielectric_fresnel


def index_of(specular: float) -> float:
    """Return the index of refraction of a level of dielectric reflection, 0.5 for 1.5."""
    upright = min(0.08 * specular, 0.999)
    return max((1 + math.sqrt(upright)) / (1 - math.sqrt(upright)), 1 + 1e-6)


def slab(cosine: np.ndarray, colour: np.ndarray, index: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the shares of light that a wall reflects and lets through.

    Parameters
    ----------
    cosine
        (n,) of the angle of incidence; its sign does not count.
    colour
        (n, 3) share in 0..1 that one passage at normal incidence lets through, surfaces left out.
    index
        Of refraction, above 1.

    Returns
    -------
    reflectance, transmittance
        (n, 3) float64; what is left of 1 is absorbed.
    """
    upright = np.clip(np.abs(cosine), 0.0, 1.0)
    face = dielectric_fresnel(upright, index)[:, None]
    refracted = np.sqrt(1 - (1 - upright**2) / index**2)[:, None]
    passage = np.clip(colour, 0.0, 1.0) ** (1 / refracted)
    transmittance = (1 - face) ** 2 * passage / np.maximum(1 - (face * passage) ** 2, 1e-12)
    return face * (1 + passage * transmittance), transmittance
