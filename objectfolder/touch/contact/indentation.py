"""How far faces reach into the gel."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math

import numpy as np

from objectfolder.jit import arrayless, inner, kernel

# A face seen along the sensor's axis with less than this share of its area is on edge: where it lies above a
# border is then rounding, and its edges, which are looked at by themselves, are all there is of it.
ON_EDGE = 1e-9


@inner(arrayless(kernel))
def _cut(low, high, value, slope):
    """Shrink an interval to where value + t slope >= 0."""
    if slope > 0:
        return max(low, -value / slope), high
    if slope < 0:
        return low, min(high, -value / slope)
    return low, -1.0 if value < 0 else high


@inner(arrayless(kernel))
def _sag(gel, y, z):
    return gel[6] * (gel[5] - math.sqrt(max(gel[5] * gel[5] - (y * y + z * z), 0.0)))


@inner(arrayless(kernel))
def _segment_maximum(start, along, low, high, gel):
    """Largest indentation on start + t along, t in low..high, from the apex."""
    if not low <= high:
        return -np.inf
    (sx, sy, sz), (ax, ay, az) = start, along
    radius, stretch = gel[5], gel[6]
    squared = ay * ay + az * az
    # d/dt of the indentation vanishes where stretch w / sqrt(chord^2 - w^2) = -slope, w = (t + middle) |a|.
    if squared > 0:
        safe = max(squared, 1e-300)
        middle = (sy * ay + sz * az) / safe
        cross = sy * az - sz * ay
        chord = math.sqrt(max(radius * radius - cross * cross / safe, 0.0))
        length = math.sqrt(safe)
        slope = ax / length
        t = -slope * chord / math.sqrt(max(stretch * stretch + slope * slope, 1e-300)) / length - middle
    else:
        t = low if ax > 0 else high
    t = min(max(t, low), high)
    x, y, z = sx + t * ax, sy + t * ay, sz + t * az
    return -_sag(gel, y, z) - x


@inner(arrayless(kernel))
def _doubled_area(corners, a, b, y, z):
    return (corners[a, 1] - y) * (corners[b, 2] - z) - (corners[a, 2] - z) * (corners[b, 1] - y)


@inner(arrayless(kernel))
def _normal(corners):
    """The cross product of two edges."""
    ux, uy, uz = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1], corners[1, 2] - corners[0, 2]
    vx, vy, vz = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1], corners[2, 2] - corners[0, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@inner(arrayless(kernel))
def _parallel_maximum(corners, gel):
    """Indentation where the gel is parallel to the triangle, if the triangle reaches there."""
    nx, ny, nz = _normal(corners)
    radius, stretch = gel[5], gel[6]
    p, q = -ny / nx, -nz / nx
    scale = radius / math.sqrt(stretch * stretch + (p * p + q * q))
    y, z = -p * scale, -q * scale
    x, least = 0.0, 0.0
    for corner in range(3):
        share = _doubled_area(corners, (corner + 1) % 3, (corner + 2) % 3, y, z) / nx
        x += share * corners[corner, 0]
        least = min(least, share)
    if least >= 0 and abs(y) <= gel[3] and abs(z) <= gel[4] and x >= gel[8] - gel[0]:
        return -_sag(gel, y, z) - x
    return -np.inf


@inner(arrayless(kernel))
def _border_maximum(corners, gel, axis, side):
    """Largest indentation on the part of the triangle above one border of the gel's extent."""
    sy, sz, ay, az = side * gel[3], -gel[4], 0.0, 2 * gel[4]
    if axis == 1:
        sy, sz, ay, az = -gel[3], side * gel[4], 2 * gel[3], 0.0
    area, ny, nz = _normal(corners)
    if abs(area) <= ON_EDGE * math.sqrt(area * area + ny * ny + nz * nz):
        return -np.inf
    low, high, x, towards = 0.0, 1.0, 0.0, 0.0
    for opposite in range(3):
        p, q = (opposite + 1) % 3, (opposite + 2) % 3
        value = _doubled_area(corners, p, q, sy, sz) / area
        slope = _doubled_area(corners, p, q, sy + ay, sz + az) / area - value
        low, high = _cut(low, high, value, slope)
        x += value * corners[opposite, 0]
        towards += slope * corners[opposite, 0]
    low, high = _cut(low, high, x - (gel[8] - gel[0]), towards)
    return _segment_maximum((x, sy, sz), (towards, ay, az), low, high, gel)


@arrayless(kernel)
def indentation(triangle, gel, corners):
    """Largest indentation of the gel by a triangle (3, 3), sensor frame, along the sensor's axis, metres.

    The indentation gel_x(y, z) - x is concave over a triangle, so its maximum over the part of the
    triangle under the gel and ahead of the camera is at the one point where the gel is parallel to the
    triangle, or on a border: an edge of the triangle, or of the gel. All have closed forms. Of a face
    that crosses the camera's near plane, and so fills the sensor, only the ends of the cut are tried.
    It is -infinity for a triangle outside the gel's extent. `corners` (3, 3) is working memory.
    """
    crossing = False
    for corner in range(3):
        for axis in range(3):
            corners[corner, axis] = triangle[corner, axis] - gel[axis]
        crossing |= abs(corners[corner, 1]) > gel[3] or abs(corners[corner, 2]) > gel[4]
    best = _parallel_maximum(corners, gel)
    for start in range(3):
        s, e = corners[start], corners[(start + 1) % 3]
        ax, ay, az = e[0] - s[0], e[1] - s[1], e[2] - s[2]
        low, high = _cut(0.0, 1.0, s[0] - (gel[8] - gel[0]), ax)
        low, high = _cut(low, high, gel[3] - s[1], -ay)
        low, high = _cut(low, high, gel[3] + s[1], ay)
        low, high = _cut(low, high, gel[4] - s[2], -az)
        low, high = _cut(low, high, gel[4] + s[2], az)
        best = max(best, _segment_maximum((s[0], s[1], s[2]), (ax, ay, az), low, high, gel))
    if crossing:
        for axis in range(2):
            for side in (-1.0, 1.0):
                best = max(best, _border_maximum(corners, gel, axis, side))
    return best


@arrayless(kernel)
def deepest(triangles, bounds, gel, corners):
    """Largest indentation by any of the triangles (m, 3, 3), sensor frame, at least 0.

    `bounds` (m,) are as of `FacePatches.near_gel`, and `gel` as of `gel.gel_constants`. `corners` (3, 3) is
    working memory.
    """
    greatest = 0.0
    for i in range(len(triangles)):
        if bounds[i] > greatest:
            greatest = max(greatest, indentation(triangles[i], gel, corners))
    return greatest
