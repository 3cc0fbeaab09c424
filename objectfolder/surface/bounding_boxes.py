"""A bounding volume hierarchy in numpy: nearest hit, occlusion and closest point for many queries at once.

Breadth first over all queries, one level of the tree a step, so that the work is array arithmetic.
It needs nothing but numpy, in double precision; `Surface` prefers Embree for rays where it is installed.
"""

from collections.abc import Callable, Iterator

import numpy as np

LEAF_TRIANGLES = 4
QUERIES_AT_ONCE = 1 << 15
BOXES_AT_FIRST = 256


class BoundingBoxTree:
    """A complete binary tree of axis-aligned boxes over triangles: children of node i are 2 i + 1, 2 i + 2.

    Parameters
    ----------
    triangles
        (F, 3, 3) float64 corners.

    Attributes
    ----------
    boxes : (nodes, 6) float64
        Lower and upper corners; of a node that holds nothing infinity and -infinity.
    order : (leaves, LEAF_TRIANGLES) int64
        Faces of each leaf, the last nodes of all; -1: none.
    """

    def __init__(self, triangles: np.ndarray) -> None:
        self.triangles = triangles
        count = len(triangles)
        depth = max(0, int(np.ceil(np.log2(max(1, count) / LEAF_TRIANGLES))))
        slots = LEAF_TRIANGLES << depth
        order = np.full(slots, -1, dtype=np.int64)
        order[:count] = np.arange(count)
        centroid = np.full((slots, 3), np.inf)
        centroid[:count] = triangles.mean(axis=1)
        for level in range(depth):
            size = slots >> level
            by_node = centroid[order].reshape(-1, size, 3)
            by_node[order.reshape(-1, size) < 0] = np.nan
            with np.errstate(all="ignore"):
                extent = np.fmax.reduce(by_node, axis=1) - np.fmin.reduce(by_node, axis=1)
            axis = np.argmax(np.nan_to_num(extent, nan=-1.0), axis=1)
            key = np.take_along_axis(by_node, axis[:, None, None], axis=2)[..., 0]
            local = np.argsort(key, axis=1, kind="stable")
            order = np.take_along_axis(order.reshape(-1, size), local, axis=1).ravel()
        self.order = order.reshape(-1, LEAF_TRIANGLES)
        low = np.full((slots, 3), np.inf)
        high = np.full((slots, 3), -np.inf)
        used = order >= 0
        low[used] = triangles[order[used]].min(axis=1)
        high[used] = triangles[order[used]].max(axis=1)
        levels = [
            (low.reshape(1 << level, -1, 3).min(axis=1), high.reshape(1 << level, -1, 3).max(axis=1))
            for level in range(depth + 1)
        ]
        self.boxes = np.concatenate([np.concatenate(level, axis=1) for level in levels])

    def _pairs(
        self, count: int, enters: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of queries and faces in the leaves they reach, level by level.

        `enters` says of pairs of queries (n,) and boxes, lower and upper corners (n, 3), which go on.
        """
        leaves = len(self.order)
        # A few queries begin further down: numpy takes as long for one box as for a hundred.
        width = 1
        while 2 * width * max(count, 1) <= BOXES_AT_FIRST and width < leaves:
            width *= 2
        query, node = np.repeat(np.arange(count), width), np.tile(np.arange(width - 1, 2 * width - 1), count)
        while True:
            box = self.boxes[node]
            full = box[:, 0] <= box[:, 3]
            query, node, box = query[full], node[full], box[full]
            entered = enters(query, box[:, :3], box[:, 3:])
            query, node = query[entered], node[entered]
            if len(node) == 0 or node[0] >= leaves - 1:
                break
            query, node = np.repeat(query, 2), np.repeat(2 * node + 1, 2)
            node[1::2] += 1
        face = self.order[node - leaves + 1].ravel()
        query = np.repeat(query, LEAF_TRIANGLES)
        return query[face >= 0], face[face >= 0]

    def _hits(
        self, origins: np.ndarray, directions: np.ndarray, limit: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Queries, the faces whose leaf boxes they pass before the limit, and how far these are."""
        with np.errstate(divide="ignore"):
            inverse = 1.0 / directions

        def passes(query: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
            with np.errstate(invalid="ignore"):
                first = (low - origins[query]) * inverse[query]
                second = (high - origins[query]) * inverse[query]
            # 0 * inf: the ray runs in the plane of the face of a box, which then does not cut it.
            near = np.fmax.reduce(np.fmin(first, second), axis=1, initial=0.0)
            far = np.fmin.reduce(np.fmax(first, second), axis=1, initial=np.inf)
            # Rounding may empty a flat box: one part in 1e12 of the distance keeps it.
            return np.asarray((near <= far * (1 + 1e-12)) & (near <= limit))

        query, face = self._pairs(len(origins), passes)
        return query, face, intersect(self.triangles[face], origins[query], directions[query])[0]

    def nearest_hits(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Index (n,) of the first face each ray hits, -1 where there is none."""
        result = np.full(len(origins), -1, dtype=np.int64)
        for part in _parts(len(origins)):
            query, face, distance = self._hits(origins[part], directions[part], np.inf)
            hit = np.isfinite(distance)
            query, face = _least(query[hit], face[hit], distance[hit])
            result[part.start + query] = face
        return result

    def occluded(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Whether (n,) something lies between ``origins`` and ``origins + directions``."""
        result = np.zeros(len(origins), dtype=bool)
        for part in _parts(len(origins)):
            query, _, distance = self._hits(origins[part], directions[part], 1.0)
            result[part.start + query[distance < 1.0]] = True
        return result

    def closest_faces(self, points: np.ndarray) -> np.ndarray:
        """Index (n,) of the face nearest to each point; the lowest index among equals."""
        result = np.empty(len(points), dtype=np.int64)
        for part in _parts(len(points)):
            query, face = self._near(points[part])
            barycentric = closest_barycentric(self.triangles[face], points[part][query])
            query, face = _least(query, face, _gap(self.triangles[face], barycentric, points[part][query]))
            result[part.start + query] = face
        return result

    def _near(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Queries, and the faces in boxes no farther from their points than any box is at its farthest."""
        bound = np.full(len(points), np.inf)

        def may_be_nearest(query: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
            position = points[query]
            outside = np.maximum(np.maximum(low - position, position - high), 0.0)
            across = np.maximum(np.abs(position - low), np.abs(high - position))
            np.minimum.at(bound, query, np.einsum("ij,ij->i", across, across))
            nearest = np.einsum("ij,ij->i", outside, outside)
            return np.asarray(nearest <= bound[query] * (1 + 1e-12))

        return self._pairs(len(points), may_be_nearest)


def _parts(count: int) -> Iterator[slice]:
    """Slices of the queries that keep the number of live (query, node) pairs bounded."""
    starts = range(0, count, QUERIES_AT_ONCE)
    return (slice(start, min(start + QUERIES_AT_ONCE, count)) for start in starts)


def _least(query: np.ndarray, face: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each query once, with its face of least value; the lowest face among equals."""
    order = np.lexsort((face, value, query))
    query, face = query[order], face[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = query[1:] != query[:-1]
    return query[first], face[first]


def intersect(
    triangles: np.ndarray, origins: np.ndarray, directions: np.ndarray, tolerance: float = 1e-12
) -> tuple[np.ndarray, np.ndarray]:
    """Intersect rays with triangles one to one (Möller and Trumbore 1997), both sides.

    Parameters
    ----------
    triangles, origins, directions
        (n, 3, 3), (n, 3), (n, 3).
    tolerance
        How far, in barycentric units, a hit may lie outside.

    Returns
    -------
    distance
        (n,) in units of the direction's length; infinity where there is no hit ahead.
    barycentric
        (n, 3); meaningless where there is no hit.
    """
    a, edge1, edge2 = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(directions, edge2)
    determinant = np.einsum("ij,ij->i", edge1, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / determinant
        offset = origins - a
        u = np.einsum("ij,ij->i", offset, p) * inverse
        q = np.cross(offset, edge1)
        v = np.einsum("ij,ij->i", directions, q) * inverse
        distance = np.einsum("ij,ij->i", edge2, q) * inverse
        hit = (determinant != 0) & (u >= -tolerance) & (v >= -tolerance) & (u + v <= 1 + tolerance)
        hit &= distance > 0
    u, v = np.where(hit, u, 0.0), np.where(hit, v, 0.0)
    return np.where(hit, distance, np.inf), np.stack([1 - u - v, u, v], axis=1)


def closest_barycentric(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (n, 3) of the point of each triangle nearest to its point.

    Ericson, *Real-Time Collision Detection* (2005), section 5.1.5, by regions of the plane.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    best = _on_segment(a, b, points, 0, 1)
    best_gap = _gap(triangles, best, points)
    for start, end, first, second in ((b, c, 1, 2), (c, a, 2, 0)):
        candidate = _on_segment(start, end, points, first, second)
        gap = _gap(triangles, candidate, points)
        nearer = gap < best_gap
        best[nearer], best_gap[nearer] = candidate[nearer], gap[nearer]
    ab, ac, ap = b - a, c - a, points - a
    d00, d01, d11 = (np.einsum("ij,ij->i", x, y) for x, y in ((ab, ab), (ab, ac), (ac, ac)))
    d20, d21 = np.einsum("ij,ij->i", ap, ab), np.einsum("ij,ij->i", ap, ac)
    area = d00 * d11 - d01 * d01
    with np.errstate(divide="ignore", invalid="ignore"):
        v, w = (d11 * d20 - d01 * d21) / area, (d00 * d21 - d01 * d20) / area
        inside = (area > 0) & (v >= 0) & (w >= 0) & (v + w <= 1)
    v, w = v[inside], w[inside]
    best[inside] = np.stack([1 - v - w, v, w], axis=1)
    return best


def _gap(triangles: np.ndarray, barycentric: np.ndarray, points: np.ndarray) -> np.ndarray:
    gap = np.einsum("ij,ijk->ik", barycentric, triangles) - points
    return np.einsum("ij,ij->i", gap, gap)


def _on_segment(
    start: np.ndarray, end: np.ndarray, points: np.ndarray, first: int, second: int
) -> np.ndarray:
    along = end - start
    squared = np.einsum("ij,ij->i", along, along)
    t = np.einsum("ij,ij->i", points - start, along)
    t = np.clip(np.divide(t, squared, out=np.zeros_like(t), where=squared > 0), 0.0, 1.0)
    barycentric = np.zeros((len(points), 3))
    barycentric[:, first], barycentric[:, second] = 1 - t, t
    return barycentric
