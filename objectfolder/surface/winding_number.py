"""The generalised winding number of a surface: about 1 inside, 0 outside, whatever is missing from it.

Jacobson, Kavan and Sorkine-Hornung, "Robust Inside-Outside Segmentation Using Generalized Winding Numbers"
(2013); far parts of the surface are summed up as dipoles, as in Barill, Dickson, Schmidt, Levin and Jacobson,
"Fast Winding Numbers for Soups and Clouds" (2018).
"""

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.integrals import counted_again
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
LEAF = 8
DIPOLE_RADII = 2.0  # radii of a group of faces at which it counts as one dipole
WINDING_POINTS = 2048


class WindingNumber:
    """The winding number of a surface at any points."""

    def __init__(self, surface: Surface) -> None:
        triangles = surface.vertices[surface.faces]
        count = len(triangles)
        self._depth = max(0, int(np.ceil(np.log2(count / LEAF))))
        order = np.arange(count)
        centroid = triangles.mean(axis=1)
        groups = [order]
        for _ in range(self._depth):
            groups = [half for group in groups for half in _halves(group, centroid)]
        order = np.concatenate(groups)
        self._triangles = triangles[order]
        sizes = np.array([len(group) for group in groups])
        self._first = np.concatenate([[0], np.cumsum(sizes)])
        vector = (surface.face_normals * surface.face_areas[:, None])[order]
        area = surface.face_areas[order]
        weighted = centroid[order] * area[:, None]
        self._levels = []
        for level in range(self._depth + 1):
            step = 1 << (self._depth - level)
            edges = self._first[::step]
            total = np.maximum(np.add.reduceat(area, edges[:-1]), 1e-300)
            centre = np.add.reduceat(weighted, edges[:-1], axis=0) / total[:, None]
            owner = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
            reach = np.linalg.norm(self._triangles - centre[owner][:, None], axis=2).max(axis=1)
            radius = np.maximum.reduceat(reach, edges[:-1])
            self._levels.append((centre, np.add.reduceat(vector, edges[:-1], axis=0), radius))

    def __call__(self, points: Floats) -> Floats:
        """Winding number at (n, 3) points, (n,)."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        result = np.zeros(len(points))
        for start in range(0, len(points), WINDING_POINTS):
            result[start : start + WINDING_POINTS] = self._at(points[start : start + WINDING_POINTS])
        return result

    def _at(self, points: Floats) -> Floats:
        result = np.zeros(len(points))
        query = np.arange(len(points))
        node = np.zeros(len(points), dtype=np.int64)
        for level, (centre, vector, radius) in enumerate(self._levels):
            away = centre[node] - points[query]
            distance = np.linalg.norm(away, axis=1)
            far = distance > DIPOLE_RADII * radius[node]
            dipole = np.einsum("ij,ij->i", vector[node[far]], away[far]) / (4 * np.pi * distance[far] ** 3)
            result += np.bincount(query[far], dipole, len(points))
            query, node = query[~far], node[~far]
            if level < self._depth:
                query = np.repeat(query, 2)
                node = np.repeat(2 * node, 2)
                node[1::2] += 1
        count = self._first[node + 1] - self._first[node]
        before = np.cumsum(count) - count
        face = np.arange(count.sum()) + np.repeat(self._first[node] - before, count)
        query = np.repeat(query, count)
        result += np.bincount(query, solid_angles(self._triangles[face], points[query]), len(points)) / (
            4 * np.pi
        )
        return result


def solid_angles(triangles: Floats, points: Floats) -> Floats:
    """Signed solid angle (n,) of triangles (n, 3, 3) from points (n, 3): van Oosterom and Strackee (1983)."""
    a, b, c = np.moveaxis(triangles - points[:, None], 1, 0)
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = la * lb * lc
    for first, second, length in ((a, b, lc), (b, c, la), (c, a, lb)):
        below = below + np.einsum("ij,ij->i", first, second) * length
    return np.asarray(2 * np.arctan2(above, below), dtype=np.float64)


def is_closed(surface: Surface) -> bool:
    """Whether every edge is run along as often one way as the other, so that the surface has a volume."""
    return not surface.edges.imbalance.any()


def enclosed_volume(surface: Surface, *, samples: int = 32768, seed: int = 0) -> tuple[float, float]:
    """Volume enclosed, and its standard error, in cubic units of length.

    Of a closed surface the signed volume less what it counts again (see `overlap`): exact, error 0,
    where no patches overlap. Of another the volume where the winding number is above a half, from points
    spread evenly over the bounding box, one drawn in each cell of a grid.

    Examples
    --------
    >>> from trimesh.creation import box
    >>> cube = box((2, 2, 2))
    >>> enclosed_volume(Surface(cube.vertices, cube.faces))
    (8.0, 0.0)
    """
    low, high = surface.bounds
    if is_closed(surface):
        corner = surface.vertices[surface.faces] - (low + high) / 2
        again = counted_again(surface, seed=seed)
        return float(np.linalg.det(corner).sum() / 6 - again.volumes.sum()), again.uncertainty
    size = np.maximum(high - low, 1e-3 * (high - low).max())
    cell = float(np.prod(size) / samples) ** (1 / 3)
    counts = np.maximum(1, np.round(size / cell)).astype(np.int64)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3)
    offset = np.random.default_rng(seed).random(index.shape)
    inside = WindingNumber(surface)(low + (index + offset) * size / counts) > 0.5
    share = float(inside.mean())
    box = float(np.prod(size))
    # Where all points are inside, or none, one in as many might not have been.
    variance = max(share * (1 - share), 1 / len(index))
    return box * share, box * float(np.sqrt(variance / len(index)))


def _halves(group: NDArray[np.int64], centroid: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    places = centroid[group]
    axis = int(np.argmax(np.ptp(places, axis=0)))
    ordered = group[np.argsort(places[:, axis], kind="stable")]
    return ordered[: len(ordered) // 2], ordered[len(ordered) // 2 :]
