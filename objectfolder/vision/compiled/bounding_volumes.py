"""A bounding volume hierarchy over triangles and its ray queries.

Binary, split by the binned surface area heuristic (Wald 2007); boxes in single precision, widened for its
rounding, triangles in double (Möller and Trumbore 1997), both sides.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

from typing import NamedTuple

import numpy as np

from objectfolder.jit import arrayless, inner, kernel

LEAF_TRIANGLES = 4
BINS = 16
# Boxes are this much larger (unit frame): float32 rounding of the slab test at distances of up to 10.
PADDING = 4e-6
# How far outside a triangle, in barycentric units, a ray still hits it: no ray slips between two.
TOLERANCE = 1e-10
# Nodes from this level on are halved, whatever their faces: 2^31 faces end 31 levels below, and a ray's stack
# holds 96 nodes at most. By areas alone, triangles in a geometric series down to 1e-271 need 183 levels.
HALVED_LEVEL = 64
STACK = 128
# Share of their distance within which a ray meets two front faces as one.
ALIKE = 1e-9


class BoundingVolumes(NamedTuple):
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
        order, boxes, children, counts = _build(triangles.min(axis=1), triangles.max(axis=1))
        a = triangles[:, 0]
        edges = np.concatenate([a, triangles[:, 1] - a, triangles[:, 2] - a], axis=1)
        return cls(boxes, children, counts, edges[order], order)

    def first_hits(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return face (n,) int32 (-1: none) and barycentric coordinates (n, 3) of each ray's first hit."""
        face, barycentric = np.full(len(origins), -1, dtype=np.int32), np.zeros((len(origins), 3))
        stack, entry = np.empty(STACK, dtype=np.int32), np.empty(STACK, dtype=np.float32)
        _first_hits(self, origins, directions, stack, entry, face, barycentric)
        return face, barycentric

    def front_faces(
        self, origins: np.ndarray, directions: np.ndarray, reach: np.ndarray, most: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the faces that rays meet from their front, the nearest first.

        Parameters
        ----------
        origins, directions, reach
            (n, 3), (n, 3), and the (n,) distances, in lengths of the directions, up to which faces count.
        most
            Faces of a ray; those beyond are left out.

        Returns
        -------
        ray, face, barycentric
            (m,) int64, (m,) int32 and (m, 3), ordered by ray.
        """
        face = np.empty((len(origins), most), dtype=np.int32)
        place, count = np.empty((len(origins), most, 3)), np.zeros(len(origins), dtype=np.int64)
        stack = np.empty(STACK, dtype=np.int32)
        _front_faces(self, origins, directions, reach, stack, face, place, count)
        ray, rank = np.nonzero(np.arange(most) < count[:, None])
        second, third = place[ray, rank, 1], place[ray, rank, 2]
        return ray, face[ray, rank], np.stack([1 - second - third, second, third], axis=1)

    def occluded(self, origins: np.ndarray, target: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """Whether (n,) a face lies strictly between origins (n, 3) and target (3,) or (n, 3).

        Of those alone where `mask` (n,) is true.
        """
        targets, blocked = target.reshape(-1, 3), np.zeros(len(origins), dtype=bool)
        _occluded(self, origins, targets, mask, np.empty(STACK, dtype=np.int32), blocked)
        return blocked


Tree = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _build(low: np.ndarray, high: np.ndarray) -> Tree:
    """Return the order of the leaves, boxes, children and counts of a tree over boxes (n, 3), level by level.

    Array arithmetic: kernels for it would take longer to compile than the trees of many objects to build.
    """
    order, base = np.arange(len(low), dtype=np.int32), 0
    bounds = np.concatenate([low, -high], axis=1)  # the box of several is their minimum
    levels: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    first, last = np.zeros(1, dtype=np.int64), np.array([len(low)])
    while len(first):
        size = last - first
        owner = np.repeat(np.arange(len(first)), size)
        place = np.arange(len(owner)) + np.repeat(first - np.cumsum(size) + size, size)
        right = _right(bounds[order[place]], owner, size, halve=len(levels) >= HALVED_LEVEL)
        side = 2 * owner + right
        order[place] = order[place[np.argsort(side, kind="stable")]]
        counts = np.bincount(side, minlength=2 * len(first))
        start = np.stack([first, first + counts[::2]], axis=1).ravel()
        extents = np.full((len(counts), 6), np.inf)
        extents[counts > 0] = _joined(bounds[order[place]], counts[counts > 0])
        boxes = np.concatenate([extents[:, :3] - PADDING, PADDING - extents[:, 3:]], axis=1).astype(
            np.float32
        )
        inner = counts > LEAF_TRIANGLES
        base += len(first)
        children = np.where(inner, base + np.cumsum(inner) - 1, ~start)
        levels.append((boxes, children, np.where(inner, 0, counts)))
        first, last = start[inner], (start + counts)[inner]
    boxes, children, counts = (np.concatenate(part) for part in zip(*levels, strict=True))
    pairs = children.reshape(-1, 2).astype(np.int32), counts.reshape(-1, 2).astype(np.int32)
    return order, boxes.reshape(-1, 2, 6), *pairs


def _joined(bounds: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the boxes of runs of `sizes` faces, none of them empty."""
    joined: np.ndarray = np.minimum.reduceat(bounds, np.cumsum(sizes) - sizes, axis=0)
    return joined if len(sizes) else np.empty((0, 6))


def _area(bounds: np.ndarray) -> np.ndarray:
    """Half the surfaces of boxes (..., 6)."""
    x, y, z = np.moveaxis(-bounds[..., 3:] - bounds[..., :3], -1, 0)
    area: np.ndarray = x * y + y * z + z * x
    return area


def _right(bounds: np.ndarray, owner: np.ndarray, size: np.ndarray, *, halve: bool) -> np.ndarray:
    """Whether (n,) faces lie behind the cheapest of BINS planes an axis of their nodes, or their middle.

    Parameters
    ----------
    bounds, owner
        (n, 6) and (n,) int64 node of each face, in order.
    size
        (m,) faces of each node.
    halve
        Whether the middle is taken of every node.
    """
    start = np.cumsum(size) - size
    right = np.arange(len(owner)) - start[owner] >= np.maximum(size // 2, 1)[owner]
    cheapest = np.full(len(size), np.inf)
    if halve or not len(owner):
        return right
    for axis in range(3):
        centre = bounds[:, axis] - bounds[:, 3 + axis]
        least = np.minimum.reduceat(centre, start)
        extent = np.maximum.reduceat(centre, start) - least
        extent[extent == 0] = np.inf
        slot = np.minimum(BINS * ((centre - least[owner]) / extent[owner]), BINS - 1).astype(np.int64)
        key = owner * BINS + slot
        count = np.bincount(key, minlength=len(size) * BINS)
        bins = np.full((len(count), 6), np.inf)
        bins[count > 0] = _joined(bounds[np.argsort(key, kind="stable")], count[count > 0])
        bins, count = bins.reshape(-1, BINS, 6), count.reshape(-1, BINS)
        before = np.minimum.accumulate(bins, axis=1)[:, :-1]
        behind = np.minimum.accumulate(bins[:, ::-1], axis=1)[:, -2::-1]
        in_front = np.cumsum(count, axis=1)[:, :-1]
        left_over = size[:, None] - in_front
        cost = np.full(in_front.shape, np.inf)
        parted = (in_front > 0) & (left_over > 0)
        cost[parted] = _area(before[parted]) * in_front[parted] + _area(behind[parted]) * left_over[parted]
        plane = np.argmin(cost, axis=1)
        cost = cost[np.arange(len(cost)), plane]
        better = cost < cheapest
        cheapest[better] = cost[better]
        right = np.where(better[owner], slot > plane[owner], right)
    return right


@inner(arrayless(kernel))
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


@inner(arrayless(kernel))
def _inverse(value):
    # Not quite parallel to any side of a box: 0 * infinity would be no number.
    if abs(value) < 1e-18:
        value = 1e-18 if value >= 0 else -1e-18
    return np.float32(1.0 / value)


@inner(arrayless(kernel))
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


@arrayless(kernel)
def _first_hits(volumes, origins, directions, stack, entry, face_of_ray, barycentric):
    boxes, children, counts, triangles, faces = volumes
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
                        distance == nearest and distance < np.inf and faces[position] < face_of_ray[ray]
                    ):
                        nearest = distance
                        limit = np.float32(distance * (1 + 1e-6))
                        face_of_ray[ray] = faces[position]
                        barycentric[ray, 0], barycentric[ray, 1], barycentric[ray, 2] = 1 - u - v, u, v


@arrayless(kernel)
def _front_faces(volumes, origins, directions, reach, stack, faces_of_ray, place, number):
    """Write what `BoundingVolumes.front_faces` parts: place (n, most, 3) is distance and two coordinates."""
    boxes, children, counts, triangles, faces = volumes
    most = faces_of_ray.shape[1]
    for ray in range(len(origins)):
        ox, oy, oz = origins[ray, 0], origins[ray, 1], origins[ray, 2]
        dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
        fx, fy, fz, limit = np.float32(ox), np.float32(oy), np.float32(oz), np.float32(reach[ray])
        stack[0], height = 0, 1
        while height:
            height -= 1
            node = stack[height]
            for side in range(2):
                if _enter(boxes[node, side], fx, fy, fz, ix, iy, iz, limit) == np.inf:
                    continue
                child = children[node, side]
                if child >= 0:
                    stack[height] = child
                    height += 1
                    continue
                for position in range(~child, ~child + counts[node, side]):
                    t = triangles[position]
                    nx, ny, nz = (
                        t[4] * t[8] - t[5] * t[7],
                        t[5] * t[6] - t[3] * t[8],
                        t[3] * t[7] - t[4] * t[6],
                    )
                    if not nx * dx + ny * dy + nz * dz < 0.0:
                        continue
                    distance, u, v = _meet(t, ox, oy, oz, dx, dy, dz)
                    if not distance < reach[ray]:
                        continue
                    # Along an edge of two faces a ray meets both at one distance, and counts it once.
                    last, again = number[ray], False
                    for rank in range(number[ray]):
                        again |= abs(place[ray, rank, 0] - distance) <= ALIKE * distance
                    if again:
                        continue
                    while last > 0 and place[ray, last - 1, 0] > distance:
                        if last < most:
                            faces_of_ray[ray, last] = faces_of_ray[ray, last - 1]
                            for k in range(3):
                                place[ray, last, k] = place[ray, last - 1, k]
                        last -= 1
                    if last < most:
                        faces_of_ray[ray, last] = faces[position]
                        place[ray, last, 0], place[ray, last, 1], place[ray, last, 2] = distance, u, v
                        number[ray] = min(number[ray] + 1, most)


@arrayless(kernel)
def _occluded(volumes, origins, targets, mask, stack, blocked):
    boxes, children, counts, triangles, _ = volumes
    one = np.float32(1.0)
    for ray in range(len(origins)):
        if not mask[ray]:
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
