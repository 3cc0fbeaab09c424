"""Which face each camera ray meets first: a z-buffer over the few faces near the gel."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from objectfolder.touch.sensor.camera import RayGrid

FRAGMENTS_AT_ONCE = 1 << 20
# Columns and rows of rays; keeps rays that pass along an edge in the faces on both of its sides.
SLACK = 1e-7


@dataclass(frozen=True)
class Visible:
    """Samples in which a face lies before the gel.

    ``sample`` (k,) flat index into the ray grid, ``face`` (k,) row of the triangles, ``barycentric``
    (3, k), ``depth`` (k,) metres along the camera's axis.
    """

    sample: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray
    depth: np.ndarray


def rasterise(triangles: np.ndarray, grid: RayGrid) -> Visible:
    """Find the nearest face before the gel along each ray, either side of a face visible.

    A point of the ray d = (1, u, v) lies in the triangle (a, b, c), all from the camera, where
    (b x c).d, (c x a).d and (a x b).d have one sign (Olano and Greer 1997): no clipping is needed for
    faces that reach behind the camera. In a row of rays these are linear in u: each face covers an interval.

    Parameters
    ----------
    triangles
        (m, 3, 3) corners from the camera, in the sensor's axes, metres.
    grid
        Rays, and the depth of the gel along them.
    """
    edges = np.cross(triangles[:, [1, 2, 0]], triangles[:, [2, 0, 1]])
    normal = edges.sum(axis=1)
    offset = np.einsum("ij,ij->i", edges[:, 0], triangles[:, 0])
    first_row, rows = _rows(triangles, grid)
    rows[offset == 0] = 0
    nearest = grid.gel_depth.copy()
    owner = np.full(nearest.shape, -1, dtype=np.int64)
    for part in _parts(rows * len(grid.u)):
        face, i = _expand(rows[part], first_row[part])
        face += part.start
        first, columns = _columns(edges, offset, face, i, grid)
        index, j = _expand(columns, first)
        face, i = face[index], i[index]
        along = normal[face]
        facing = along[:, 0] + along[:, 1] * (grid.u[j] + grid.shift[i]) + along[:, 2] * grid.v[i]
        sample = i * len(grid.u) + j
        # A ray in the plane of a face meets it nowhere: infinite or undefined, and so never before the gel.
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = offset[face] / facing
        before = (depth < nearest[sample]) & (depth > grid.near)
        face, sample, depth = face[before], sample[before], depth[before]
        np.minimum.at(nearest, sample, depth)
        foremost = depth == nearest[sample]
        owner[sample[foremost]] = face[foremost]
    sample = np.flatnonzero(owner >= 0)
    return _barycentric(triangles, edges, normal, owner[sample], sample, nearest[sample], grid)


def _expand(counts: np.ndarray, first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For runs first[k], first[k] + 1, ... of counts[k] numbers: k and the number, for each of all."""
    index = np.repeat(np.arange(len(counts)), counts)
    start = first - (np.cumsum(counts) - counts)
    return index, np.arange(len(index)) + start[index]


def _columns(
    edges: np.ndarray, offset: np.ndarray, face: np.ndarray, i: np.ndarray, grid: RayGrid
) -> tuple[np.ndarray, np.ndarray]:
    """First column and number of columns in which a row i (n,) of rays meets each face (n,)."""
    low, high = np.zeros(len(face)), np.full(len(face), len(grid.u) - 1.0)
    spacing = grid.u[1] - grid.u[0]
    signed = edges * np.sign(offset)[:, None, None]
    v, first_u = grid.v[i], grid.u[0] + grid.shift[i]
    across, down = signed[..., 1] * spacing, signed[..., 2]
    for corner in range(3):
        value = signed[face, corner, 0] + signed[face, corner, 1] * first_u + down[face, corner] * v
        slope = across[face, corner]
        with np.errstate(divide="ignore", invalid="ignore"):
            root = -value / slope
        np.maximum(low, root, out=low, where=slope > 0)
        np.minimum(high, root, out=high, where=slope < 0)
        high[(slope == 0) & (value < 0)] = -1.0
    first, last = np.ceil(np.minimum(low, len(grid.u)) - SLACK), np.floor(np.maximum(high, -1.0) + SLACK)
    return first.astype(np.int64), np.maximum(last - first + 1, 0).astype(np.int64)


def _rows(triangles: np.ndarray, grid: RayGrid) -> tuple[np.ndarray, np.ndarray]:
    """First row of rays and number of rows that each triangle may cover."""
    x, z = triangles[:, :, 0], triangles[:, :, 2]
    ahead = (x > grid.near).all(axis=1)
    slope = z / np.where(ahead[:, None], x, 1.0)
    position = (slope - grid.v[0]) / (grid.v[1] - grid.v[0])
    first = np.ceil(position.min(axis=1) - SLACK).clip(0, len(grid.v))
    last = np.floor(position.max(axis=1) + SLACK).clip(-1, len(grid.v) - 1)
    first, last = np.where(ahead, first, 0), np.where(ahead, last, len(grid.v) - 1)
    return first.astype(np.int64), np.maximum(last - first + 1, 0).astype(np.int64)


def _barycentric(
    triangles: np.ndarray,
    edges: np.ndarray,
    normal: np.ndarray,
    face: np.ndarray,
    sample: np.ndarray,
    depth: np.ndarray,
    grid: RayGrid,
) -> Visible:
    i = sample // len(grid.u)
    u, v = grid.u[sample - i * len(grid.u)] + grid.shift[i], grid.v[i]
    weights = np.stack([edges[face, k, 0] + edges[face, k, 1] * u + edges[face, k, 2] * v for k in range(3)])
    weights /= normal[face, 0] + normal[face, 1] * u + normal[face, 2] * v
    return Visible(sample, face, weights, depth)


def _parts(count: np.ndarray) -> list[slice]:
    """Slices of the faces with about `FRAGMENTS_AT_ONCE` fragments each."""
    chunk = np.cumsum(count) // FRAGMENTS_AT_ONCE
    borders = np.flatnonzero(np.diff(chunk)) + 1
    starts = [0, *borders.tolist(), len(count)]
    return [slice(a, b) for a, b in pairwise(starts) if b > a]
