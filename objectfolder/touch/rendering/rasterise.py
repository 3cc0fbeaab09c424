"""Which face each camera ray meets first: a z-buffer over the pixels that faces near the gel may cover.

A point of the ray d = (1, u, v) lies in the triangle (a, b, c), all from the camera, where (b x c).d,
(c x a).d and (a x b).d have one sign (Olano and Greer 1997): no clipping is needed for faces that reach
behind the camera. In a row of rays these are linear in u: each face covers an interval.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

from typing import NamedTuple

import numpy as np

from objectfolder.jit import arrayless, inner, kernel

# Columns and rows of rays; keeps rays that pass along an edge in the faces on both of its sides.
RAY_SLACK = 1e-7


class Rays(NamedTuple):
    """Rays of a camera.

    Parameters
    ----------
    camera
        (3,) sensor frame, metres.
    u, shift, v
        (columns,), (rows,) and (rows,): slopes u + shift and v of the rays.
    near
        Depth of the near plane, metres.
    of_pixel
        Rays of a pixel, each in a row of its own.
    """

    camera: np.ndarray
    u: np.ndarray
    shift: np.ndarray
    v: np.ndarray
    near: float
    of_pixel: int


class Raster(NamedTuple):
    """The nearest face along each ray.

    Parameters
    ----------
    owner
        (rows, columns) int32 face, -1: none; set only in the extent.
    nearness
        (rows, columns) one over the depth along the camera's axis; set only in the extent.
    extent
        (rows, 2) first and last column outside which nothing is seen, the same for all rows of a pixel.
    edges
        (m, 3, 3) normals of the planes through the camera and the edges opposite to each corner.
    inverse
        (m,) one over the determinant of each triangle's corners from the camera.
    """

    owner: np.ndarray
    nearness: np.ndarray
    extent: np.ndarray
    edges: np.ndarray
    inverse: np.ndarray


@inner(arrayless(kernel))
def _range(a, b, c, first, pitch, count):
    """First and last ray whose slope lies between the least and greatest of three."""
    least, most = (a - first) / pitch, (a - first) / pitch
    for slope in (b, c):
        position = (slope - first) / pitch
        least, most = min(least, position), max(most, position)
    return int(np.ceil(min(max(least - RAY_SLACK, 0.0), count))), int(
        np.floor(max(min(most + RAY_SLACK, count - 1.0), -1.0))
    )


@inner(arrayless(kernel))
def _edges(triangle, camera, edges):
    """Write b x c, c x a and a x b of the corners from the camera; return a . (b x c)."""
    for corner in range(3):
        p, q = (corner + 1) % 3, (corner + 2) % 3
        px, py, pz = triangle[p, 0] - camera[0], triangle[p, 1] - camera[1], triangle[p, 2] - camera[2]
        qx, qy, qz = triangle[q, 0] - camera[0], triangle[q, 1] - camera[1], triangle[q, 2] - camera[2]
        edges[corner, 0] = py * qz - pz * qy
        edges[corner, 1] = pz * qx - px * qz
        edges[corner, 2] = px * qy - py * qx
    x, y, z = triangle[0, 0] - camera[0], triangle[0, 1] - camera[1], triangle[0, 2] - camera[2]
    return edges[0, 0] * x + edges[0, 1] * y + edges[0, 2] * z


@inner(arrayless(kernel))
def _rows(triangle, camera, v, near):
    """First and last row of rays that a face may cover."""
    x0, x1, x2 = triangle[0, 0] - camera[0], triangle[1, 0] - camera[0], triangle[2, 0] - camera[0]
    if not (x0 > near and x1 > near and x2 > near):
        return 0, len(v) - 1
    z0, z1, z2 = triangle[0, 2] - camera[2], triangle[1, 2] - camera[2], triangle[2, 2] - camera[2]
    return _range(z0 / x0, z1 / x1, z2 / x2, v[0], v[1] - v[0], len(v))


@inner(arrayless(kernel))
def _columns(edges, sign, rays, first, rows, lows, highs, used):
    """Write first and last column in which `rows` rows of rays from `first` on meet a face, whole.

    Each edge bounds the columns from one side. Row `first` is at `used` of `lows` and `highs`.
    """
    u, shift, v = rays.u, rays.shift, rays.v
    spacing, count = u[1] - u[0], float(len(u))
    for row in range(rows):
        lows[used + row], highs[used + row] = 0.0, count - 1
    for corner in range(3):
        constant, down = sign * (edges[corner, 0] + edges[corner, 1] * u[0]), sign * edges[corner, 2]
        across = sign * edges[corner, 1]
        slope = across * spacing
        inverse = -1 / slope
        for row in range(rows):
            root = (constant + down * v[first + row] + across * shift[first + row]) * inverse
            at = used + row
            if slope > 0:
                lows[at] = root if root > lows[at] else lows[at]
            elif slope < 0:
                highs[at] = root if root < highs[at] else highs[at]
            else:
                highs[at] = -1.0 if constant + down * v[first + row] < 0 else highs[at]
    for at in range(used, used + rows):
        low, high = lows[at], highs[at]
        lows[at] = np.ceil((low if low < count else count) - RAY_SLACK)
        highs[at] = np.floor((high if high > -1.0 else -1.0) + RAY_SLACK)


@inner(arrayless(kernel))
def _nearer(best, owner, u, columns, face, plane, limit):
    """Write a face where it is the nearest, and not behind the gel, along columns first..end of a row."""
    constant, slope = plane
    for j in range(columns[0], columns[1]):
        nearness = constant + slope * u[j]
        before = (nearness >= best[j]) & (nearness < limit)
        best[j] = nearness if before else best[j]
        owner[j] = face if before else owner[j]


@arrayless(kernel)
def _faces(triangles, bounds, rays, edges, inverse, rows):
    """Write normals and inverse determinants of a `Raster`, and first and last row (m, 2).

    Returns how many rows there are, over all faces.
    """
    total = 0
    for face in range(len(triangles)):
        inverse[face], rows[face, 0], rows[face, 1] = 0.0, 0, -1
        if not bounds[face] > 0:
            continue
        determinant = _edges(triangles[face], rays.camera, edges[face])
        if determinant == 0 or not np.isfinite(1 / determinant):
            continue
        inverse[face] = 1 / determinant
        first, last = _rows(triangles[face], rays.camera, rays.v, rays.near)
        if first <= last:
            rows[face, 0], rows[face, 1] = first, last
            total += last - first + 1
    return total


@inner(arrayless(kernel))
def _widest(extent, start, rays):
    """Make the extent of the rows of a pixel that of all of them; return it."""
    first, last = extent[start, 0], extent[start, 1]
    for row in range(start + 1, start + rays):
        first, last = min(first, extent[row, 0]), max(last, extent[row, 1])
    for row in range(start, start + rays):
        extent[row, 0], extent[row, 1] = first, last
    return first, last


@arrayless(kernel)
def _rasterise(rays, gel_nearness, raster, rows, lows, highs):
    """Write what `rasterise` returns; `rows` are as of `_faces`, `lows` and `highs` are working memory."""
    u, shift, v = rays.u, rays.shift, rays.v
    owner, best, extent, edges, inverse = raster
    for row in range(len(v)):
        extent[row, 0], extent[row, 1] = len(u), -1
    used = np.uint64(0)
    for face in range(len(rows)):
        first, count = rows[face, 0], np.uint64(rows[face, 1] + 1 - rows[face, 0])
        sign = 1.0 if inverse[face] > 0 else -1.0
        _columns(edges[face], sign, rays, np.uint64(first), count, lows, highs, used)
        for row in range(first, rows[face, 1] + 1):
            low, high = int(lows[used]), int(highs[used])
            if low <= high:
                extent[row, 0], extent[row, 1] = min(extent[row, 0], low), max(extent[row, 1], high)
            used += np.uint64(1)
    for start in range(0, len(v), rays.of_pixel):
        first, last = _widest(extent, start, rays.of_pixel)
        for row in range(start, start + rays.of_pixel):
            for j in range(np.uint64(first), np.uint64(last + 1)):
                best[row, j] = gel_nearness[row, j]
                owner[row, j] = -1
    limit = 1 / rays.near
    used = np.uint64(0)
    for face in range(len(rows)):
        e, scale = edges[face], inverse[face]
        along = e[0, 0] + e[1, 0] + e[2, 0]
        slope = (e[0, 1] + e[1, 1] + e[2, 1]) * scale
        down = e[0, 2] + e[1, 2] + e[2, 2]
        for row in range(rows[face, 0], rows[face, 1] + 1):
            first, last = int(lows[used]), int(highs[used])
            used += np.uint64(1)
            if first <= last:
                constant = (along + down * v[row]) * scale + slope * shift[row]
                columns = np.uint64(first), np.uint64(last + 1)
                _nearer(best[row], owner[row], u, columns, face, (constant, slope), limit)


def rasterise(triangles: np.ndarray, bounds: np.ndarray, rays: Rays, gel_nearness: np.ndarray) -> Raster:
    """Find the nearest face before the gel along each ray.

    Parameters
    ----------
    triangles
        (m, 3, 3) sensor frame, metres. Of faces equally near the last is seen.
    bounds
        (m,) metres; faces of 0 or less are left out.
    rays
        Of the camera.
    gel_nearness
        (rows, columns) least one over depth of what is before the gel.
    """
    count, lines, shape = len(triangles), len(rays.v), (len(rays.v), len(rays.u))
    raster = Raster(
        np.empty(shape, dtype=np.int32), np.empty(shape), np.empty((lines, 2), dtype=np.int64),
        np.empty((count, 3, 3)), np.empty(count),
    )  # fmt: skip
    rows = np.empty((count, 2), dtype=np.int64)
    total = _faces(triangles, bounds, rays, raster.edges, raster.inverse, rows)
    _rasterise(rays, gel_nearness, raster, rows, np.empty(total), np.empty(total))
    return raster
