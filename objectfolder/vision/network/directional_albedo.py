"""How much of the light that a GGX surface receives it reflects, by quadrature over its visible normals.

Height-correlated Smith masking (Heitz 2014), half vectors as the camera sees them (Heitz 2018), real Fresnel
reflection of dielectrics. Cells are those of the truth's renderer, which is linear between them as we are.
"""

from collections.abc import Collection
from functools import cache

import numpy as np

# Cells a side, over roughness and cosine of the camera: of a white surface, and of a dielectric.
WHITE_CELLS, DIELECTRIC_CELLS = 32, 16
# Half vectors along each of two axes.
STRATA = 64
LEAST = 1e-3


def reflected_by_white(roughnesses: Collection[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the share that a surface of Fresnel factor 1 reflects in one bounce, and its mean over cosines.

    Parameters
    ----------
    roughnesses
        Which are looked up.

    Returns
    -------
    share, mean
        (32, 32) over roughness and cosine, and (32,) over roughness; rows that no look-up needs are 0.
    """
    share = np.zeros((WHITE_CELLS, WHITE_CELLS))
    for row in _rows(roughnesses, WHITE_CELLS):
        share[row] = _white_row(row)
    cosine, cells = (np.arange(512) + 0.5) / 512, np.linspace(0, 1, WHITE_CELLS)
    mean = [np.mean(2 * cosine * np.interp(cosine, cells, row)) for row in share]
    return share, np.array(mean)


def reflected_by_dielectric(index: float, roughnesses: Collection[float]) -> np.ndarray:
    """Return how far a dielectric's reflection rises from that of upright light to 1, as of a white surface.

    Parameters
    ----------
    index
        Of refraction, above 1.
    roughnesses
        Which are looked up.

    Returns
    -------
    np.ndarray
        (16, 16) over roughness and cosine; rows that no look-up needs are 0.
    """
    place = np.sqrt((index - 1) / (index + 1)) * (DIELECTRIC_CELLS - 1)
    below = min(int(place), DIELECTRIC_CELLS - 2)
    rise = np.zeros((DIELECTRIC_CELLS, DIELECTRIC_CELLS))
    for row in _rows(roughnesses, DIELECTRIC_CELLS):
        rise[row] = (below + 1 - place) * _dielectric_row(row, below)
        rise[row] += (place - below) * _dielectric_row(row, below + 1)
    return rise


def dielectric_fresnel(cosine: np.ndarray, index: float) -> np.ndarray:
    """Return the share of unpolarised light that a dielectric reflects, by cosine of incidence."""
    refracted = np.sqrt(np.maximum(index**2 - 1 + cosine**2, 0.0))
    across = (refracted - cosine) / (refracted + cosine)
    along = (cosine * (refracted + cosine) - 1) / (cosine * (refracted - cosine) + 1)
    return np.asarray(0.5 * across**2 * (1 + along**2))


def _rows(roughnesses: Collection[float], cells: int) -> list[int]:
    places = np.clip(np.fromiter(roughnesses, np.float64), 0.0, 1.0) * (cells - 1)
    return sorted({int(row) for row in np.concatenate([np.floor(places), np.ceil(places)])})


@cache
def _white_row(row: int) -> np.ndarray:
    _, share = _half_vectors(row, WHITE_CELLS)
    return np.asarray(share.mean(axis=1))


@cache
def _dielectric_row(row: int, of_index: int) -> np.ndarray:
    square = (of_index / (DIELECTRIC_CELLS - 1)) ** 2
    index = max((1 + square) / (1 - min(square, 0.9999)), 1.0001)
    upright = ((index - 1) / (index + 1)) ** 2
    cosine, share = _half_vectors(row, DIELECTRIC_CELLS)
    rise = np.clip((dielectric_fresnel(cosine, index) - upright) / (1 - upright), 0.0, 1.0)
    return np.asarray(np.where(share > 0, rise, 0.0).mean(axis=1))


def _half_vectors(row: int, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Return cosines (cells, n) with the camera of visible normals, and what each lets leave; 0: below."""
    alpha = max(row / (cells - 1), LEAST) ** 2
    camera = np.clip(np.arange(cells) / (cells - 1), LEAST, 1 - 1e-6)[:, None]
    steps = (np.arange(STRATA) + 0.5) / STRATA
    radius, angle = (part.ravel() for part in np.meshgrid(np.sqrt(steps), 2 * np.pi * steps))
    # The lobe stretched to a hemisphere, seen from the camera as a disc; the camera is in the plane of x, z.
    tilt = alpha * np.sqrt(1 - camera**2)
    long = np.hypot(tilt, camera)
    aside, upright = tilt / long, camera / long
    across, half = radius * np.cos(angle), 0.5 * (1 + upright)
    along = (1 - half) * np.sqrt(1 - across**2) + half * radius * np.sin(angle)
    towards = np.sqrt(np.maximum(1 - across**2 - along**2, 0.0))
    x, y = alpha * (aside * towards - upright * along), alpha * across
    z = np.maximum(upright * towards + aside * along, 0.0)
    length = np.sqrt(x**2 + y**2 + z**2)
    cosine = (np.sqrt(1 - camera**2) * x + camera * z) / length
    leaving = 2 * cosine * z / length - camera
    masked = 1 + smith(alpha**2, camera)
    share = masked / (masked + smith(alpha**2, np.maximum(leaving, 1e-6)))
    return cosine, np.where(leaving > 0, share, 0.0)


def smith(alpha2: float, cosine: np.ndarray) -> np.ndarray:
    """Return Smith's lambda of a GGX surface: (sqrt(1 + alpha^2 tan^2) - 1) / 2."""
    return np.asarray(0.5 * (np.sqrt(1 + alpha2 * (1 / cosine**2 - 1)) - 1))
