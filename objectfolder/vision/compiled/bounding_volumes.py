"""A bounding volume hierarchy over triangles and its ray queries.

Binary, split by the binned surface area heuristic (Wald 2007); boxes in single precision, widened for its
rounding, triangles in double (Möller and Trumbore 1997), both sides.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from objectfolder.jit import kernel

LEAF_TRIANGLES = 4
BINS = 16
# Boxes are this much larger (unit frame): float32 rounding of the slab test at distances of up to 10.
PADDING = 4e-6
# How far outside a triangle, in barycentric units, a ray still hits it: no ray slips between two.
TOLERANCE = 1e-10
STACK = 128


@dataclass(frozen=True)
class BoundingVolumes:
    """Boxes (n, 2, 6) float32 of the two children of each node, and what they are.

    Parameters
    ----------
    boxes
        Lower and upper corner of each child.
    children
        (n, 2) int32: a node, or ~(first triangle) of a leaf.
    counts
        (n, 2) int32 triangles of a leaf.
    triangles
        (F, 9) float64 first corner and two edges, in the order of the leaves.
    faces
        (F,) int32 index of each of them.
    """

    boxes: np.ndarray
    children: np.ndarray
    counts: np.ndarray
    triangles: np.ndarray
    faces: np.ndarray

    @classmethod
    def of_triangles(cls, triangles: np.ndarray) -> "BoundingVolumes":
        """Build over (F, 3, 3) corners in the unit frame."""
        low, high = triangles.min(axis=1), triangles.max(axis=1)
        order, room = np.arange(len(low), dtype=np.int32), max(1, len(low))
        boxes = np.empty((room, 2, 6), dtype=np.float32)
        children, counts = np.zeros((room, 2), dtype=np.int32), np.zeros((room, 2), dtype=np.int32)
        pending, bins = np.empty((room, 3), dtype=np.int64), np.empty((BINS + 1, 8))
        nodes = _build(low, high, order, boxes, children, counts, pending, bins)
        a = triangles[:, 0]
        edges = np.concatenate([a, triangles[:, 1] - a, triangles[:, 2] - a], axis=1)
        return cls(boxes[:nodes].copy(), children[:nodes].copy(), counts[:nodes].copy(), edges[order], order)

    def first_hits(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return face (n,) int32 (-1: none) and barycentric coordinates (n, 3) of each ray's first hit."""
        face, barycentric = np.full(len(origins), -1, dtype=np.int32), np.zeros((len(origins), 3))
        stack, entry = np.empty(STACK, dtype=np.int32), np.empty(STACK, dtype=np.float32)
        _first_hits(
            self.boxes, self.children, self.counts, self.triangles, self.faces, origins, directions,
            stack, entry, face, barycentric,
        )  # fmt: skip
        return face, barycentric

    def occluded(self, origins: np.ndarray, target: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Whether (n,) a face lies strictly between origins (n, 3) and target (3,) or (n, 3), if wanted."""
        targets, blocked = target.reshape(-1, 3), np.zeros(len(origins), dtype=bool)
        _occluded(
            self.boxes, self.children, self.counts, self.triangles, origins, targets, wanted,
            np.empty(STACK, dtype=np.int32), blocked,
        )  # fmt: skip
        return blocked


@kernel
def _clear(box):
    """Make a box hold nothing."""
    for k in range(3):
        box[k], box[3 + k] = np.inf, -np.inf


@kernel
def _join(box, other):
    """Widen a box to hold another."""
    for k in range(3):
        box[k], box[3 + k] = min(box[k], other[k]), max(box[3 + k], other[3 + k])


@kernel
def _area(box):
    """Half the surface of a box."""
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x


@kernel
def _bin(low, high, face, axis, least, extent):
    """Which of BINS slices of an axis the centre of a face lies in."""
    return min(BINS - 1, int(BINS * ((low[face, axis] + high[face, axis] - least) / extent)))


@kernel
def _fill(low, high, order, first, last, axis, least, extent, bins):
    """Write the box and the number of the faces order[first:last] in each bin of an axis."""
    for bin_ in range(BINS):
        _clear(bins[bin_])
        bins[bin_, 6] = 0.0
    for position in range(first, last):
        face = order[position]
        own = bins[_bin(low, high, face, axis, least, extent)]
        own[6] += 1.0
        for k in range(3):
            own[k], own[3 + k] = min(own[k], low[face, k]), max(own[3 + k], high[face, k])


@kernel
def _cheapest(bins, total):
    """Return the least cost of a plane between two bins, and the bin before it; infinity if there is none."""
    swept = bins[BINS]
    _clear(swept)
    count = 0.0
    for bin_ in range(BINS - 1, 0, -1):
        count += bins[bin_, 6]
        _join(swept, bins[bin_])
        bins[bin_, 7] = _area(swept) * count if count > 0 else 0.0
    _clear(swept)
    count, best, best_bin = 0.0, np.inf, 0
    for bin_ in range(BINS - 1):
        count += bins[bin_, 6]
        _join(swept, bins[bin_])
        if 0 < count < total:
            cost = _area(swept) * count + bins[bin_ + 1, 7]
            if cost < best:
                best, best_bin = cost, bin_
    return best, best_bin


@kernel
def _split(low, high, order, first, last, bins):
    """Partition order[first:last] by the cheapest of BINS planes an axis; return where, or the middle.

    `bins` (BINS + 1, 8) are working memory: the box of each, how many faces, and the cost of those behind.
    """
    best, best_axis, best_bin, best_least, best_extent = np.inf, -1, 0, 0.0, 0.0
    for axis in range(3):
        least, most = np.inf, -np.inf
        for position in range(first, last):
            centre = low[order[position], axis] + high[order[position], axis]
            least, most = min(least, centre), max(most, centre)
        if not most > least:
            continue
        _fill(low, high, order, first, last, axis, least, most - least, bins)
        cost, bin_ = _cheapest(bins, last - first)
        if cost < best:
            best, best_axis, best_bin, best_least, best_extent = cost, axis, bin_, least, most - least
    if best_axis < 0:
        return (first + last) // 2
    i, j = first, last - 1
    while i <= j:
        # A literal's type would have `_bin` compiled twice.
        if _bin(low, high, order[i], np.int64(best_axis), best_least, best_extent) <= best_bin:
            i += 1
        else:
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i


@kernel
def _build(low, high, order, boxes, children, counts, pending, bins):
    """Write a tree over boxes (n, 3) and the order of its leaves; return how many nodes it has.

    `pending` (n, 3) is working memory: ranges of `order` yet to be split, and the node each becomes.
    """
    pending[0, 0], pending[0, 1], pending[0, 2] = 0, len(low), 0
    waiting, nodes = 1, 1
    while waiting:
        waiting -= 1
        first, last, node = pending[waiting, 0], pending[waiting, 1], pending[waiting, 2]
        middle = _split(low, high, order, first, last, bins) if last - first > 1 else last
        for side in range(2):
            start, end = (first, middle) if side == 0 else (middle, last)
            box = boxes[node, side]
            for k in range(3):
                box[k], box[3 + k] = np.inf, -np.inf
            for position in range(start, end):
                face = order[position]
                for k in range(3):
                    box[k] = min(box[k], np.float32(low[face, k] - PADDING))
                    box[3 + k] = max(box[3 + k], np.float32(high[face, k] + PADDING))
            if end - start <= LEAF_TRIANGLES:
                children[node, side], counts[node, side] = ~start, end - start
            else:
                children[node, side] = nodes
                pending[waiting, 0], pending[waiting, 1], pending[waiting, 2] = start, end, nodes
                waiting += 1
                nodes += 1
    return nodes


@kernel
def _enter(box, ox, oy, oz, ix, iy, iz, limit):
    """Return where the ray enters the box, or infinity."""
    a, b = (box[0] - ox) * ix, (box[3] - ox) * ix
    near, far = min(a, b), max(a, b)
    a, b = (box[1] - oy) * iy, (box[4] - oy) * iy
    near, far = max(near, min(a, b)), min(far, max(a, b))
    a, b = (box[2] - oz) * iz, (box[5] - oz) * iz
    near, far = max(near, min(a, b)), min(far, max(a, b))
    near = max(near, np.float32(0.0))
    if near <= far and near <= limit:
        return near
    return np.float32(np.inf)


@kernel
def _inverse(value):
    # Not quite parallel to any side of a box: 0 * infinity would be no number.
    if abs(value) < 1e-18:
        value = 1e-18 if value >= 0 else -1e-18
    return np.float32(1.0 / value)


@kernel
def _meet(triangle, ox, oy, oz, dx, dy, dz):
    """Return distance (infinity: none ahead) and the second and third barycentric coordinate."""
    e1x, e1y, e1z = triangle[3], triangle[4], triangle[5]
    e2x, e2y, e2z = triangle[6], triangle[7], triangle[8]
    px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
    determinant = e1x * px + e1y * py + e1z * pz
    if determinant == 0.0:
        return np.inf, 0.0, 0.0
    inverse = 1.0 / determinant
    tx, ty, tz = ox - triangle[0], oy - triangle[1], oz - triangle[2]
    u = (tx * px + ty * py + tz * pz) * inverse
    if not (u >= -TOLERANCE and u <= 1 + TOLERANCE):
        return np.inf, 0.0, 0.0
    qx, qy, qz = ty * e1z - tz * e1y, tz * e1x - tx * e1z, tx * e1y - ty * e1x
    v = (dx * qx + dy * qy + dz * qz) * inverse
    if not (v >= -TOLERANCE and u + v <= 1 + TOLERANCE):
        return np.inf, 0.0, 0.0
    distance = (e2x * qx + e2y * qy + e2z * qz) * inverse
    if not distance > 0.0:
        return np.inf, 0.0, 0.0
    return distance, u, v


@kernel
def _first_hits(
    boxes, children, counts, triangles, faces, origins, directions, stack, entry, found, barycentric
):
    for ray in range(len(origins)):
        ox, oy, oz = origins[ray, 0], origins[ray, 1], origins[ray, 2]
        dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
        fx, fy, fz = np.float32(ox), np.float32(oy), np.float32(oz)
        nearest, limit = np.inf, np.float32(np.inf)
        stack[0], entry[0], height = 0, np.float32(0.0), 1
        while height:
            height -= 1
            if entry[height] > limit:
                continue
            node = stack[height]
            left = _enter(boxes[node, 0], fx, fy, fz, ix, iy, iz, limit)
            right = _enter(boxes[node, 1], fx, fy, fz, ix, iy, iz, limit)
            # The nearer child first: on top of the stack.
            for turn in range(2):
                side = turn if left > right else 1 - turn
                enter = left if side == 0 else right
                if enter == np.inf:
                    continue
                child = children[node, side]
                if child >= 0:
                    stack[height], entry[height] = child, enter
                    height += 1
                    continue
                for position in range(~child, ~child + counts[node, side]):
                    distance, u, v = _meet(triangles[position], ox, oy, oz, dx, dy, dz)
                    if distance < nearest or (
                        distance == nearest and distance < np.inf and faces[position] < found[ray]
                    ):
                        nearest = distance
                        limit = np.float32(distance * (1 + 1e-6))
                        found[ray] = faces[position]
                        barycentric[ray, 0], barycentric[ray, 1], barycentric[ray, 2] = 1 - u - v, u, v


@kernel
def _occluded(boxes, children, counts, triangles, origins, targets, wanted, stack, blocked):
    one = np.float32(1.0)
    for ray in range(len(origins)):
        if not wanted[ray]:
            continue
        ox, oy, oz = origins[ray, 0], origins[ray, 1], origins[ray, 2]
        target = targets[ray % len(targets)]
        dx, dy, dz = target[0] - ox, target[1] - oy, target[2] - oz
        ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
        fx, fy, fz = np.float32(ox), np.float32(oy), np.float32(oz)
        stack[0], height = 0, 1
        while height and not blocked[ray]:
            height -= 1
            node = stack[height]
            for side in range(2):
                if _enter(boxes[node, side], fx, fy, fz, ix, iy, iz, one) == np.inf:
                    continue
                child = children[node, side]
                if child >= 0:
                    stack[height] = child
                    height += 1
                    continue
                for position in range(~child, ~child + counts[node, side]):
                    distance, _, _ = _meet(triangles[position], ox, oy, oz, dx, dy, dz)
                    if distance < 1.0:
                        blocked[ray] = True
                        break
