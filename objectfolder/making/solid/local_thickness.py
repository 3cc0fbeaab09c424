"""How thick an object is at each place of its surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
MEDIAN_NEIGHBOURS = 5  # the median over these samples ignores single rays that slip through a crack


@dataclass(frozen=True)
class LocalThickness:
    """Thickness at points of a surface, in its unit of length.

    Attributes
    ----------
    points : (n, 3), uniform by area
    across : (n,) distance inwards along the normal to the other side; infinite where a ray leaves
    least : (n,) the least of `across` plus the distance to where it was measured: thickness that changes no
        faster than one per length, so that the narrow side of a blade is as thin as the blade
    """

    points: Floats
    across: Floats
    least: Floats


def local_thickness(surface: Surface, *, samples: int = 4000, seed: int = 0) -> LocalThickness:
    """Measure the thickness of a surface with outward faces at points drawn uniformly by area."""
    drawn = surface.sample(samples, seed)
    across = distances_across(surface, drawn.points, surface.face_normals[drawn.face])
    diagonal = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    near = cKDTree(drawn.points).query(drawn.points, k=min(MEDIAN_NEIGHBOURS, samples))[1]
    typical = np.minimum(np.median(across[near.reshape(samples, -1)], axis=1), diagonal)
    least = np.empty(samples)
    squared = np.einsum("ij,ij->i", drawn.points, drawn.points)
    for start in range(0, samples, 512):
        part = slice(start, start + 512)
        away = squared[part, None] + squared - 2 * drawn.points[part] @ drawn.points.T
        least[part] = (np.sqrt(np.maximum(away, 0.0)) + typical).min(axis=1)
    return LocalThickness(drawn.points, across, least)


def distances_across(surface: Surface, points: Floats, normals: Floats) -> Floats:
    """Distance (n,) from points of the surface along their reversed normals to the next face, or infinity."""
    start = 1e-6 * float(np.ptp(surface.bounds, axis=0).max())
    hits = surface.ray_hits(points - start * normals, -normals)
    return np.asarray(start + hits.distance, dtype=np.float64)
