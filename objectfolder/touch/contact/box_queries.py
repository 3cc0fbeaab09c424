"""Which faces are in oriented boxes, and near a gel.

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
# By how much rounding may move the bound of an indentation, metres.
SLACK_M = 1e-12


@kernel
def _grown(values):
    larger = np.empty(2 * len(values), values.dtype)
    larger[: len(values)] = values
    return larger


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
    stack = np.empty(STACK, np.int64)
    stack[0], height = 0, 1
    while height:
        height -= 1
        node = stack[height]
        if _boxes_apart(boxes[node], pose, centre, half):
            continue
        if node < leaves - 1:
            stack[height], stack[height + 1] = 2 * node + 2, 2 * node + 1
            height += 2
            continue
        for slot in range(order.shape[1]):
            face = order[node - leaves + 1, slot]
            if face >= 0:
                _transform(triangles[face], pose, corners)
                if _triangle_enters(corners, low, high, half):
                    return True
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
    found = 0
    stack = np.empty(STACK, np.int64)
    stack[0], height = 0, 1
    while height:
        height -= 1
        node = stack[height]
        if not _box_bound(boxes[node], pose, gel) > least:
            continue
        if node < leaves - 1:
            stack[height], stack[height + 1] = 2 * node + 2, 2 * node + 1
            height += 2
            continue
        if found + order.shape[1] > len(faces):
            faces, bounds = _grown(faces), _grown(bounds)
            larger = np.empty((len(faces), 3, 3))
            larger[:found] = corners[:found]
            corners = larger
        for slot in range(order.shape[1]):
            face = order[node - leaves + 1, slot]
            if face < 0:
                continue
            _transform(triangles[face], pose, corners[found])
            bounds[found] = _triangle_bound(corners[found], gel)
            if bounds[found] > least:
                faces[found] = face
                found += 1
    return faces[:found], corners[:found], bounds[:found]
