"""Which faces are nearest to points or near them, in oriented boxes, and near a gel.

The boxes are those of `surface.bounding_boxes.BoundingBoxTree`: children of node i are 2 i + 1 and 2 i + 2.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import kernel

# A complete tree over 2^60 faces would still fit.
STACK = 64
# Parts of a distance by which rounding may move it.
ROUNDING = 1e-12
# By how much rounding may move the bound of an indentation, metres.
SLACK_M = 1e-12


@kernel
def _behind(node):
    """The node that follows one and all below it, from left to right; -1 behind the last."""
    while node > 0 and node % 2 == 0:
        node = (node - 1) // 2
    return node + 1 if node > 0 else -1


@kernel
def _grown(values):
    larger = np.empty((2 * len(values), *values.shape[1:]), values.dtype)
    larger[: len(values)] = values
    return larger


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
def in_balls(boxes, order, points, radius):
    """See `patch.FacePatches.in_balls`."""
    count, leaves = len(points), len(order)
    starts = np.zeros(count + 1, np.int64)
    faces = np.empty(64 * max(count, 1), np.int64)
    found = 0
    reach = radius * radius * (1 + ROUNDING)
    for i in range(count):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        node = 0
        while node >= 0:
            near = _squared_distance(boxes[node], x, y, z) <= reach
            if near and node < leaves - 1:
                node = 2 * node + 1
                continue
            if near:
                if found + order.shape[1] > len(faces):
                    faces = _grown(faces)
                for face in order[node - leaves + 1]:
                    if face >= 0:
                        faces[found] = face
                        found += 1
            node = _behind(node)
        starts[i + 1] = found
    return starts, faces[:found]


@kernel
def _boxes_apart(box, pose, centre, half):
    """Whether one of the boxes' own six axes separates them; also where `box` holds nothing."""
    if not box[0] <= box[3]:
        return True
    hx, hy, hz = (box[3] - box[0]) / 2, (box[4] - box[1]) / 2, (box[5] - box[2]) / 2
    x, y, z = box[0] + hx - centre[0], box[1] + hy - centre[1], box[2] + hz - centre[2]
    slack = ROUNDING * (abs(x) + abs(y) + abs(z) + hx + hy + hz)
    for axis in range(3):
        rx, ry, rz = pose[0, axis], pose[1, axis], pose[2, axis]
        reach = half[axis] + abs(rx) * hx + abs(ry) * hy + abs(rz) * hz
        if abs(x * rx + y * ry + z * rz) > reach + slack:
            return True
    for axis, distance, own in ((0, x, hx), (1, y, hy), (2, z, hz)):
        reach = own
        for other in range(3):
            reach += abs(pose[axis, other]) * half[other]
        if abs(distance) > reach + slack:
            return True
    return False


@kernel
def _centre_of(pose, low, high):
    half = (high - low) / 2
    centre = np.empty(3)
    for axis in range(3):
        centre[axis] = pose[axis, 3]
        for other in range(3):
            centre[axis] += pose[axis, other] * (low[other] + half[other])
    return centre, half


@kernel
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


@kernel
def _separates(corners, half, ax, ay, az):
    """Whether the axis separates a triangle (3, 3) from the open box of half extents round the origin."""
    reach = abs(ax) * half[0] + abs(ay) * half[1] + abs(az) * half[2]
    a = corners[0, 0] * ax + corners[0, 1] * ay + corners[0, 2] * az
    b = corners[1, 0] * ax + corners[1, 1] * ay + corners[1, 2] * az
    c = corners[2, 0] * ax + corners[2, 1] * ay + corners[2, 2] * az
    return reach > 0 and (min(min(a, b), c) >= reach or max(max(a, b), c) <= -reach)


@kernel
def _triangle_enters(corners, low, high, half):
    """Separating axes of a triangle and a box (Akenine-Möller 2001); touching is not entering."""
    for axis in range(3):
        a, b, c = corners[0, axis], corners[1, axis], corners[2, axis]
        if not (min(min(a, b), c) < high[axis] and max(max(a, b), c) > low[axis]):
            return False
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


@kernel
def enters_box(boxes, order, triangles, pose, low, high):
    """See `patch.FacePatches.enters_box`."""
    leaves = len(order)
    centre, half = _centre_of(pose, low, high)
    corners = np.empty((3, 3))
    node = 0
    while node >= 0:
        meets = not _boxes_apart(boxes[node], pose, centre, half)
        if meets and node < leaves - 1:
            node = 2 * node + 1
            continue
        if meets:
            for face in order[node - leaves + 1]:
                if face >= 0:
                    _transform(triangles[face], pose, corners)
                    if _triangle_enters(corners, low, high, half):
                        return True
        node = _behind(node)
    return False


@kernel
def _bound(low_x, high_x, y, z, gel):
    """Greatest indentation by what lies in low_x..high_x and at least (y, z) from the gel's axis."""
    if y > gel[3] or z > gel[4] or high_x < gel[8]:
        return -np.inf
    sag = gel[6] * (gel[5] - np.sqrt(max(gel[5] * gel[5] - (y * y + z * z), 0.0)))
    return gel[0] - sag - low_x + SLACK_M


@kernel
def _box_bound(box, pose, gel):
    """Greatest indentation by what a box holds."""
    if not box[0] <= box[3]:
        return -np.inf
    hx, hy, hz = (box[3] - box[0]) / 2, (box[4] - box[1]) / 2, (box[5] - box[2]) / 2
    x, y, z = box[0] + hx - pose[0, 3], box[1] + hy - pose[1, 3], box[2] + hz - pose[2, 3]
    slack = ROUNDING * (abs(x) + abs(y) + abs(z) + hx + hy + hz)
    along = x * pose[0, 0] + y * pose[1, 0] + z * pose[2, 0]
    reach = abs(pose[0, 0]) * hx + abs(pose[1, 0]) * hy + abs(pose[2, 0]) * hz + slack
    across = abs(x * pose[0, 1] + y * pose[1, 1] + z * pose[2, 1] - gel[1])
    across -= abs(pose[0, 1]) * hx + abs(pose[1, 1]) * hy + abs(pose[2, 1]) * hz + slack
    up = abs(x * pose[0, 2] + y * pose[1, 2] + z * pose[2, 2] - gel[2])
    up -= abs(pose[0, 2]) * hx + abs(pose[1, 2]) * hy + abs(pose[2, 2]) * hz + slack
    return _bound(along - reach, along + reach, max(across, 0.0), max(up, 0.0), gel)


@kernel
def _triangle_bound(corners, gel):
    """Greatest indentation by the box round a triangle (3, 3), sensor frame."""
    a, b, c = corners[0], corners[1], corners[2]
    low_y, high_y = min(min(a[1], b[1]), c[1]) - gel[1], max(max(a[1], b[1]), c[1]) - gel[1]
    low_z, high_z = min(min(a[2], b[2]), c[2]) - gel[2], max(max(a[2], b[2]), c[2]) - gel[2]
    y, z = max(max(low_y, -high_y), 0.0), max(max(low_z, -high_z), 0.0)
    return _bound(min(min(a[0], b[0]), c[0]), max(max(a[0], b[0]), c[0]), y, z, gel)


@kernel
def near_gel(boxes, order, triangles, pose, gel, least):
    """See `patch.FacePatches.near_gel`."""
    leaves = len(order)
    faces, bounds, corners = np.empty(512, np.int64), np.empty(512), np.empty((512, 3, 3))
    found, node = 0, 0
    while node >= 0:
        near = _box_bound(boxes[node], pose, gel) > least
        if near and node < leaves - 1:
            node = 2 * node + 1
            continue
        if near:
            if found + order.shape[1] > len(faces):
                faces, bounds, corners = _grown(faces), _grown(bounds), _grown(corners)
            for face in order[node - leaves + 1]:
                if face >= 0:
                    _transform(triangles[face], pose, corners[found])
                    bounds[found] = _triangle_bound(corners[found], gel)
                    if bounds[found] > least:
                        faces[found] = face
                        found += 1
        node = _behind(node)
    return faces[:found], corners[:found], bounds[:found]
