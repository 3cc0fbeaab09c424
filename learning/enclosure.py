"""Which points a closed surface encloses: a ray from each along x leaves it an odd number of times.

Points are ordered once by where they lie in y and z, and each triangle meets those of its own columns alone:
a million points in a scan of 16,000 triangles take 40 ms, and rays through a tree of boxes a second.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np
import trimesh
from numpy.typing import NDArray

from objectfolder.jit import kernel

POINTS_A_COLUMN = 8


class Columns:
    """Points (n, 3), ordered by columns along x, that surfaces are asked for one after another."""

    def __init__(self, points: NDArray[np.floating]) -> None:
        points = np.asarray(points, dtype=np.float64)
        self._side = max(1, round((len(points) / POINTS_A_COLUMN) ** 0.5))
        across = points[:, 1:]
        low, high = (across.min(axis=0), across.max(axis=0)) if len(points) else (np.zeros(2), np.ones(2))
        self._corner, self._scale = low, self._side / np.maximum(high - low, 1e-12)
        places = np.minimum(((across - low) * self._scale).astype(np.int64), self._side - 1)
        columns = places[:, 0] * self._side + places[:, 1]
        self._order = np.argsort(columns, kind="stable")
        self._first = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=self._side**2))])
        self._points = points[self._order]

    def inside(self, mesh: trimesh.Trimesh) -> NDArray[np.bool_]:
        """Return which of the points (n,) a closed mesh encloses."""
        odd = np.zeros(len(self._points), dtype=np.bool_)
        vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
        faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
        _cross(vertices, faces, self._points, self._first, self._corner, self._scale, self._side, odd)
        result = np.empty_like(odd)
        result[self._order] = odd
        return result


@kernel
def _cross(vertices, faces, points, first, corner, scale, side, odd):
    """Turn over for each point how many faces lie ahead of it along x, odd or even.

    An edge is followed from its vertex of lower number in both of its faces: a point is on one and the same
    side of it in both, and crosses one of them.

    Parameters
    ----------
    vertices, faces
        (n, 3) float64 and (m, 3) int64 of a closed surface.
    points
        (p, 3) ordered by columns.
    first
        (side**2 + 1,) number of the first point of each column.
    corner, scale
        (2,) where the columns begin in y and z, and how many a unit of length has.
    odd
        (p,) bool; changed.
    """
    for face in faces:
        a, b, c = vertices[face[0]], vertices[face[1]], vertices[face[2]]
        area = (b[1] - a[1]) * (c[2] - a[2]) - (c[1] - a[1]) * (b[2] - a[2])
        if area == 0:
            continue
        slope_y = ((b[0] - a[0]) * (c[2] - a[2]) - (c[0] - a[0]) * (b[2] - a[2])) / area
        slope_z = ((b[1] - a[1]) * (c[0] - a[0]) - (c[1] - a[1]) * (b[0] - a[0])) / area
        low_y = (min(a[1], b[1], c[1]) - corner[0]) * scale[0]
        high_y = (max(a[1], b[1], c[1]) - corner[0]) * scale[0]
        low_z = (min(a[2], b[2], c[2]) - corner[1]) * scale[1]
        high_z = (max(a[2], b[2], c[2]) - corner[1]) * scale[1]
        if high_y < 0 or high_z < 0 or low_y > side or low_z > side:
            continue
        last_row, last_column = min(int(high_y), side - 1), min(int(high_z), side - 1)
        first_column = min(max(int(low_z), 0), side - 1)
        for row in range(min(max(int(low_y), 0), side - 1), last_row + 1):
            for number in range(first[row * side + first_column], first[row * side + last_column + 1]):
                point = points[number]
                y, z = point[1], point[2]
                ahead = a[0] + slope_y * (y - a[1]) + slope_z * (z - a[2])
                if point[0] >= ahead:
                    continue
                within = False
                for corner_number in range(3):
                    start, end = face[corner_number], face[(corner_number + 1) % 3]
                    if start > end:
                        start, end = end, start
                    from_y, to_y = vertices[start, 1], vertices[end, 1]
                    if (from_y > y) != (to_y > y):
                        from_z, to_z = vertices[start, 2], vertices[end, 2]
                        if z < from_z + (y - from_y) * (to_z - from_z) / (to_y - from_y):
                            within = not within
                if within:
                    odd[number] = not odd[number]
