"""Which faces are nearest to points, and which are near them.

The boxes are those of `patch.FacePatches`: the children of node i are 2 i + 1 and 2 i + 2.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import kernel

# A complete tree over 2^60 faces would still fit.
STACK = 64
# Parts of a distance by which rounding may move it.
ROUNDING = 1e-12


@kernel
def _squared_distance(box, x, y, z):
    dx = max(max(box[0] - x, x - box[3]), 0.0)
    dy = max(max(box[1] - y, y - box[4]), 0.0)
    dz = max(max(box[2] - z, z - box[5]), 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel
def _segment_parameter(a, b, x, y, z):
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    squared = ux * ux + uy * uy + uz * uz
    if not squared > 0:
        return 0.0
    return min(max(((x - a[0]) * ux + (y - a[1]) * uy + (z - a[2]) * uz) / squared, 0.0), 1.0)


@kernel
def _squared_gap(triangle, first, second, third, x, y, z):
    total = 0.0
    for axis, coordinate in enumerate((x, y, z)):
        gap = first * triangle[0, axis] + second * triangle[1, axis] + third * triangle[2, axis] - coordinate
        total += gap * gap
    return total


@kernel
def _closest_on(triangle, x, y, z):
    """Barycentric coordinates of the nearest point, and its squared distance (Ericson 2005, 5.1.5)."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    bx, by, bz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    cx, cy, cz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    px, py, pz = x - a[0], y - a[1], z - a[2]
    d00 = bx * bx + by * by + bz * bz
    d01 = bx * cx + by * cy + bz * cz
    d11 = cx * cx + cy * cy + cz * cz
    d20 = px * bx + py * by + pz * bz
    d21 = px * cx + py * cy + pz * cz
    area = d00 * d11 - d01 * d01
    if area > 0:
        v, w = (d11 * d20 - d01 * d21) / area, (d00 * d21 - d01 * d20) / area
        if v >= 0 and w >= 0 and v + w <= 1:
            return 1 - v - w, v, w, _squared_gap(triangle, 1 - v - w, v, w, x, y, z)
    t = _segment_parameter(a, b, x, y, z)
    first, second, third = 1 - t, t, 0.0
    least = _squared_gap(triangle, first, second, third, x, y, z)
    t = _segment_parameter(b, c, x, y, z)
    gap = _squared_gap(triangle, 0.0, 1 - t, t, x, y, z)
    if gap < least:
        first, second, third, least = 0.0, 1 - t, t, gap
    t = _segment_parameter(c, a, x, y, z)
    gap = _squared_gap(triangle, t, 0.0, 1 - t, x, y, z)
    if gap < least:
        first, second, third, least = t, 0.0, 1 - t, gap
    return first, second, third, least


@kernel
def closest(boxes, order, triangles, points):
    """See `patch.FacePatches.closest`."""
    count, leaves = len(points), len(order)
    face = np.full(count, -1, np.int64)
    barycentric = np.zeros((count, 3))
    stack = np.empty(STACK, np.int64)
    for i in range(count):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        least = np.inf
        stack[0], height = 0, 1
        while height:
            height -= 1
            node = stack[height]
            if not _squared_distance(boxes[node], x, y, z) <= least * (1 + ROUNDING):
                continue
            if node < leaves - 1:
                left = _squared_distance(boxes[2 * node + 1], x, y, z)
                right = _squared_distance(boxes[2 * node + 2], x, y, z)
                # The nearer child first: on top of the stack.
                nearer = 0 if left <= right else 1
                stack[height], stack[height + 1] = 2 * node + 2 - nearer, 2 * node + 1 + nearer
                height += 2
                continue
            for slot in range(order.shape[1]):
                candidate = order[node - leaves + 1, slot]
                if candidate < 0:
                    continue
                first, second, third, gap = _closest_on(triangles[candidate], x, y, z)
                if gap < least or (gap == least and candidate < face[i]):
                    least, face[i] = gap, candidate
                    barycentric[i, 0], barycentric[i, 1], barycentric[i, 2] = first, second, third
    return face, barycentric


@kernel
def _grown(values):
    larger = np.empty(2 * len(values), values.dtype)
    larger[: len(values)] = values
    return larger


@kernel
def in_balls(boxes, order, points, radius):
    """See `patch.FacePatches.in_balls`."""
    count, leaves = len(points), len(order)
    starts = np.zeros(count + 1, np.int64)
    faces = np.empty(64 * max(count, 1), np.int64)
    found = 0
    stack = np.empty(STACK, np.int64)
    reach = radius * radius * (1 + ROUNDING)
    for i in range(count):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        stack[0], height = 0, 1
        while height:
            height -= 1
            node = stack[height]
            if not _squared_distance(boxes[node], x, y, z) <= reach:
                continue
            if node < leaves - 1:
                stack[height], stack[height + 1] = 2 * node + 2, 2 * node + 1
                height += 2
                continue
            if found + order.shape[1] > len(faces):
                faces = _grown(faces)
            for slot in range(order.shape[1]):
                if order[node - leaves + 1, slot] >= 0:
                    faces[found] = order[node - leaves + 1, slot]
                    found += 1
        starts[i + 1] = found
    return starts, faces[:found]
