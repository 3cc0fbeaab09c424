"""Which faces are nearest to points or near them, in oriented boxes, and near a gel.

The boxes are those of `surface.bounding_boxes.BoundingBoxTree`: children of node i are 2 i + 1 and 2 i + 2.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from typing import NamedTuple

import numpy as np

from objectfolder.jit import arrayless, inner, kernel

# A complete tree over 2^60 faces would still fit.
TREE_STACK = 64
# Parts of a distance by which rounding may move it.
ROUNDING = 1e-12
# By how much rounding may move the bound of an indentation, metres.
SLACK_M = 1e-12


class Tree(NamedTuple):
    """Triangles (F, 3, 3) and the boxes over them; see `surface.bounding_boxes.BoundingBoxTree`."""

    boxes: np.ndarray
    order: np.ndarray
    triangles: np.ndarray


@inner(arrayless(kernel))
def _behind(node):
    """The node that follows one and all below it, from left to right; -1 behind the last."""
    while node > 0 and node % 2 == 0:
        node = (node - 1) // 2
    return node + 1 if node > 0 else -1


@inner(arrayless(kernel))
def _squared_distance(box, x, y, z):
    dx = max(max(box[0] - x, x - box[3]), 0.0)
    dy = max(max(box[1] - y, y - box[4]), 0.0)
    dz = max(max(box[2] - z, z - box[5]), 0.0)
    return dx * dx + dy * dy + dz * dz


@inner(arrayless(kernel))
def _segment_parameter(a, b, x, y, z):
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    squared = ux * ux + uy * uy + uz * uz
    if not squared > 0:
        return 0.0
    return min(max(((x - a[0]) * ux + (y - a[1]) * uy + (z - a[2]) * uz) / squared, 0.0), 1.0)


@inner(arrayless(kernel))
def _squared_gap(triangle, first, second, third, x, y, z):
    total = 0.0
    for axis, coordinate in enumerate((x, y, z)):
        gap = first * triangle[0, axis] + second * triangle[1, axis] + third * triangle[2, axis] - coordinate
        total += gap * gap
    return total


@inner(arrayless(kernel))
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


@arrayless(kernel)
def closest(tree, points, stack, face, barycentric):
    """Write the answer of `patch.FacePatches.closest`; `stack` (`TREE_STACK`,) int64 is working memory."""
    boxes, order, triangles = tree
    leaves = len(order)
    for i in range(len(points)):
        face[i] = -1
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


@arrayless(kernel)
def in_balls(tree, points, radius, starts, faces):
    """Write the answer of `patch.FacePatches.in_balls`, as far as there is room; return the faces found."""
    boxes, order = tree.boxes, tree.order
    leaves = len(order)
    count = 0
    starts[0] = 0
    reach = radius * radius * (1 + ROUNDING)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        node = np.int64(0)  # a literal would have `_behind` compiled twice
        while node >= 0:
            near = _squared_distance(boxes[node], x, y, z) <= reach
            if near and node < leaves - 1:
                node = 2 * node + 1
                continue
            if near:
                for slot in range(order.shape[1]):
                    face = order[node - leaves + 1, slot]
                    if face >= 0:
                        if count < len(faces):
                            faces[count] = face
                        count += 1
            node = _behind(node)
        starts[i + 1] = count
    return count


@inner(arrayless(kernel))
def _bound_box(box, pose, bounds):
    """Write least and greatest coordinates (6,) of a box in the frame of `pose`, with room for rounding."""
    for axis in range(3):
        middle, reach = 0.0, 0.0
        for k in range(3):
            half = (box[3 + k] - box[k]) / 2
            along = box[k] + half - pose[k, 3]
            middle += along * pose[k, axis]
            reach += half * abs(pose[k, axis]) + ROUNDING * (abs(along) + half)
        bounds[axis], bounds[3 + axis] = middle - reach, middle + reach


@inner(arrayless(kernel))
def _bound_triangle(corners, bounds):
    """Write least and greatest coordinates (6,) of corners (3, 3)."""
    for axis in range(3):
        a, b, c = corners[0, axis], corners[1, axis], corners[2, axis]
        bounds[axis], bounds[3 + axis] = min(min(a, b), c), max(max(a, b), c)


@inner(arrayless(kernel))
def _overlap(bounds, low, high):
    """Whether the insides of two boxes meet."""
    apart = False
    for axis in range(3):
        apart |= not (bounds[axis] < high[axis] and bounds[3 + axis] > low[axis])
    return not apart


@inner(arrayless(kernel))
def _transform(triangle, pose, corners):
    """Write corners (3, 3) of a triangle in the frame of `pose`; equal points get equal bits."""
    for corner in range(3):
        x, y, z = (
            triangle[corner, 0] - pose[0, 3],
            triangle[corner, 1] - pose[1, 3],
            triangle[corner, 2] - pose[2, 3],
        )
        for axis in range(3):
            corners[corner, axis] = x * pose[0, axis] + y * pose[1, axis] + z * pose[2, axis]


@inner(arrayless(kernel))
def _separates(corners, half, ax, ay, az):
    """Whether the axis separates a triangle (3, 3) from the open box of half extents round the origin."""
    reach = abs(ax) * half[0] + abs(ay) * half[1] + abs(az) * half[2]
    a = corners[0, 0] * ax + corners[0, 1] * ay + corners[0, 2] * az
    b = corners[1, 0] * ax + corners[1, 1] * ay + corners[1, 2] * az
    c = corners[2, 0] * ax + corners[2, 1] * ay + corners[2, 2] * az
    return reach > 0 and (min(min(a, b), c) >= reach or max(max(a, b), c) <= -reach)


@inner(arrayless(kernel))
def _triangle_enters(corners, low, high, half):
    """Separating axes of a triangle and a box (Akenine-Möller 2001), but not the box's own three."""
    for axis in range(3):
        for corner in range(3):
            corners[corner, axis] -= (low[axis] + high[axis]) / 2
    for edge in range(3):
        following = (edge + 1) % 3
        x = corners[following, 0] - corners[edge, 0]
        y = corners[following, 1] - corners[edge, 1]
        z = corners[following, 2] - corners[edge, 2]
        if (
            _separates(corners, half, 0.0, -z, y)
            or _separates(corners, half, z, 0.0, -x)
            or _separates(corners, half, -y, x, 0.0)
        ):
            return False
    bx, by, bz = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1], corners[1, 2] - corners[0, 2]
    cx, cy, cz = corners[2, 0] - corners[1, 0], corners[2, 1] - corners[1, 1], corners[2, 2] - corners[1, 2]
    return not _separates(corners, half, by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx)


@arrayless(kernel)
def enters_box(tree, pose, low, high, half, corners, bounds):
    """See `patch.FacePatches.enters_box`.

    `half` (3,) are of the box's sides; `corners` (3, 3) and `bounds` (6,) are working memory.
    """
    boxes, order, triangles = tree
    leaves = len(order)
    node = np.int64(0)
    while node >= 0:
        _bound_box(boxes[node], pose, bounds)
        meets = _overlap(bounds, low, high)
        if meets and node < leaves - 1:
            node = 2 * node + 1
            continue
        if meets:
            for slot in range(order.shape[1]):
                face = order[node - leaves + 1, slot]
                if face >= 0:
                    _transform(triangles[face], pose, corners)
                    _bound_triangle(corners, bounds)
                    if _overlap(bounds, low, high) and _triangle_enters(corners, low, high, half):
                        return True
        node = _behind(node)
    return False


@inner(arrayless(kernel))
def _indentation_bound(bounds, gel):
    """Greatest indentation by what lies in a box, coordinates (6,) in the sensor frame."""
    y = max(max(bounds[1] - gel[1], gel[1] - bounds[4]), 0.0)
    z = max(max(bounds[2] - gel[2], gel[2] - bounds[5]), 0.0)
    if not bounds[0] <= bounds[3] or y > gel[3] or z > gel[4] or bounds[3] < gel[8]:
        return -np.inf
    sag = gel[6] * (gel[5] - math.sqrt(max(gel[5] * gel[5] - (y * y + z * z), 0.0)))
    return gel[0] - sag - bounds[0] + SLACK_M


@arrayless(kernel)
def near_gel(tree, pose, gel, least, box, faces, corners, bounds):
    """Write the answer of `patch.FacePatches.near_gel` as far as there is room, and return the faces found.

    Working memory are `box` (6,), and one row more of the others than there is room for.
    """
    boxes, order, triangles = tree
    leaves, room = len(order), len(faces) - 1
    count, node = 0, np.int64(0)
    while node >= 0:
        _bound_box(boxes[node], pose, box)
        near = _indentation_bound(box, gel) > least
        if near and node < leaves - 1:
            node = 2 * node + 1
            continue
        if near:
            for slot in range(order.shape[1]):
                face = order[node - leaves + 1, slot]
                if face >= 0:
                    row = min(count, room)
                    _transform(triangles[face], pose, corners[row])
                    _bound_triangle(corners[row], box)
                    bounds[row] = _indentation_bound(box, gel)
                    if bounds[row] > least:
                        faces[row] = face
                        count += 1
        node = _behind(node)
    return count
