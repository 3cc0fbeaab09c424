"""Which face each camera ray meets first: a z-buffer over the pixels that faces near the gel may cover.

A point of the ray d = (1, u, v) lies in the triangle (a, b, c), all from the camera, where (b x c).d,
(c x a).d and (a x b).d have one sign (Olano and Greer 1997): no clipping is needed for faces that reach
behind the camera. In a row of rays these are linear in u: each face covers an interval.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import kernel

# Columns and rows of rays; keeps rays that pass along an edge in the faces on both of its sides.
SLACK = 1e-7


@kernel
def _range(a, b, c, first, pitch, count):
    """First and last ray whose slope lies between the least and greatest of three."""
    least, most = (a - first) / pitch, (a - first) / pitch
    for slope in (b, c):
        position = (slope - first) / pitch
        least, most = min(least, position), max(most, position)
    return int(np.ceil(min(max(least - SLACK, 0.0), count))), int(
        np.floor(max(min(most + SLACK, count - 1.0), -1.0))
    )


@kernel
def _edges(triangle, camera, edges):
    """Write b x c, c x a and a x b of the corners from the camera; return a . (b x c)."""
    for corner in range(3):
        p, q = triangle[(corner + 1) % 3], triangle[(corner + 2) % 3]
        px, py, pz = p[0] - camera[0], p[1] - camera[1], p[2] - camera[2]
        qx, qy, qz = q[0] - camera[0], q[1] - camera[1], q[2] - camera[2]
        edges[corner, 0] = py * qz - pz * qy
        edges[corner, 1] = pz * qx - px * qz
        edges[corner, 2] = px * qy - py * qx
    a = triangle[0]
    return (
        edges[0, 0] * (a[0] - camera[0]) + edges[0, 1] * (a[1] - camera[1]) + edges[0, 2] * (a[2] - camera[2])
    )


@kernel
def _rows(triangle, camera, v, near):
    """First and last row of rays that a face may cover."""
    x0, x1, x2 = triangle[0, 0] - camera[0], triangle[1, 0] - camera[0], triangle[2, 0] - camera[0]
    if not (x0 > near and x1 > near and x2 > near):
        return 0, len(v) - 1
    z0, z1, z2 = triangle[0, 2] - camera[2], triangle[1, 2] - camera[2], triangle[2, 2] - camera[2]
    return _range(z0 / x0, z1 / x1, z2 / x2, v[0], v[1] - v[0], len(v))


@kernel
def _columns(edges, sign, u, shift, v, lows, highs):
    """Write first and last column in which each row (slopes u + shift and v) of rays meets a face, whole.

    Each edge bounds the columns from one side.
    """
    spacing, count = u[1] - u[0], float(len(u))
    for row in range(len(v)):
        lows[row], highs[row] = 0.0, count - 1
    for corner in range(3):
        constant, down = sign * (edges[corner, 0] + edges[corner, 1] * u[0]), sign * edges[corner, 2]
        across = sign * edges[corner, 1]
        slope = sign * edges[corner, 1] * spacing
        inverse = -1 / slope
        if slope > 0:
            for row in range(len(v)):
                root = (constant + down * v[row] + across * shift[row]) * inverse
                lows[row] = root if root > lows[row] else lows[row]
        elif slope < 0:
            for row in range(len(v)):
                root = (constant + down * v[row] + across * shift[row]) * inverse
                highs[row] = root if root < highs[row] else highs[row]
        else:
            for row in range(len(v)):
                highs[row] = -1.0 if constant + down * v[row] < 0 else highs[row]
    for row in range(len(v)):
        low, high = lows[row], highs[row]
        lows[row] = np.ceil((low if low < count else count) - SLACK)
        highs[row] = np.floor((high if high > -1.0 else -1.0) + SLACK)


@kernel
def _grown(values, least):
    larger = np.empty(max(2 * len(values), least))
    larger[: len(values)] = values
    return larger


@kernel
def _start(gel_nearness, best, owner):
    for j in range(len(best)):
        best[j] = gel_nearness[j]
        owner[j] = -1


@kernel
def _nearer(best, owner, u, face, constant, slope, limit):
    """Write a face where it is the nearest, and not behind the gel, along part of a row of rays."""
    for j in range(len(best)):
        nearness = constant + slope * u[j]
        before = (nearness >= best[j]) & (nearness < limit)
        best[j] = nearness if before else best[j]
        owner[j] = face if before else owner[j]


@kernel
def _covered(triangles, bounds, camera, u, shift, v, near):
    """Rows and columns of rays that each face covers.

    Returns the planes' normals and inverse determinants as `rasterise` does; first and last column (rows, 2)
    that any face covers; first and last row (m, 2) of each face, and where in the last two arrays its first
    and last column in each of these rows begin (m,).
    """
    count = len(triangles)
    edges, inverse = np.empty((count, 3, 3)), np.zeros(count)
    extent = np.empty((len(v), 2), np.int64)
    extent[:, 0], extent[:, 1] = len(u), -1
    rows, starts = np.empty((count, 2), np.int64), np.empty(count, np.int64)
    lows, highs = np.empty(8 * len(v)), np.empty(8 * len(v))
    used = 0
    for face in range(count):
        rows[face, 0], rows[face, 1] = 0, -1
        if not bounds[face] > 0:
            continue
        determinant = _edges(triangles[face], camera, edges[face])
        if determinant == 0 or not np.isfinite(1 / determinant):
            continue
        inverse[face] = 1 / determinant
        first, last = _rows(triangles[face], camera, v, near)
        if first > last:
            continue
        rows[face, 0], rows[face, 1], starts[face] = first, last, used
        end = used + last - first + 1
        if end > len(lows):
            lows, highs = _grown(lows, end), _grown(highs, end)
        sign = 1.0 if determinant > 0 else -1.0
        part = slice(first, last + 1)
        _columns(edges[face], sign, u, shift[part], v[part], lows[used:end], highs[used:end])
        for row in range(first, last + 1):
            low, high = int(lows[used + row - first]), int(highs[used + row - first])
            if low <= high:
                extent[row, 0] = min(extent[row, 0], low)
                extent[row, 1] = max(extent[row, 1], high)
        used = end
    return edges, inverse, extent, rows, starts, lows, highs


@kernel
def rasterise(triangles, bounds, camera, u, shift, v, gel_nearness, near, rays):
    """Find the nearest face before the gel along each ray.

    Parameters
    ----------
    triangles
        (m, 3, 3) sensor frame, metres. Of faces equally near the last is seen.
    bounds
        (m,) metres; faces of 0 or less are left out.
    camera
        (3,).
    u, shift, v
        (columns,), (rows,) and (rows,): slopes u + shift and v of the rays.
    gel_nearness
        (rows, columns) least one over depth of what is before the gel.
    near
        Depth of the near plane, metres.
    rays
        Of a pixel, each in a row of its own.

    Returns
    -------
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
    count = len(triangles)
    edges, inverse, extent, rows, starts, lows, highs = _covered(triangles, bounds, camera, u, shift, v, near)
    best, owner = np.empty((len(v), len(u))), np.empty((len(v), len(u)), np.int32)
    for start in range(0, len(v), rays):
        first, last = extent[start : start + rays, 0].min(), extent[start : start + rays, 1].max()
        part = slice(first, last + 1)
        for row in range(start, start + rays):
            extent[row, 0], extent[row, 1] = first, last
            _start(gel_nearness[row][part], best[row][part], owner[row][part])
    limit = 1 / near
    for face in range(count):
        e, scale = edges[face], inverse[face]
        along = e[0, 0] + e[1, 0] + e[2, 0]
        slope = (e[0, 1] + e[1, 1] + e[2, 1]) * scale
        down = e[0, 2] + e[1, 2] + e[2, 2]
        for row in range(rows[face, 0], rows[face, 1] + 1):
            at = starts[face] + row - rows[face, 0]
            first, last = int(lows[at]), int(highs[at])
            if first <= last:
                part = slice(first, last + 1)
                constant = (along + down * v[row]) * scale + slope * shift[row]
                _nearer(best[row][part], owner[row][part], u[part], face, constant, slope, limit)
    return owner, best, extent, edges, inverse
