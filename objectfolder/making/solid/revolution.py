"""Surfaces of revolution: told from others by the rings that their vertices lie on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from objectfolder.surface.connectivity import edge_table
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import enclosed_volume, is_closed

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Lengths over the diagonal: vertices so near in the half plane are of one ring, and so near to it in the end.
RING_SIZE, MOST_OFF_RING = 1e-4, 2e-5
# Relative difference of the two equal second moments of the surface.
EQUAL_MOMENTS = 1e-3
# Degrees between the faces around a ring: fewer sides are a prism (see `facing_target.ROUND`).
MOST_TURN_DEG, LARGEST_GAP_DEG = 24.0, 61.0
AXIS_STEPS = 3
# Relative difference of the triangles' area and volume from those of the round body.
MOST_DIFFERENCE = 0.03


@dataclass(frozen=True)
class Revolution:
    """A closed surface of revolution.

    Attributes
    ----------
    frame : (3, 3) rows: two directions across the axis, and the axis
    centre : (3,) on the axis
    profile : (n, 2) radius and height of the rings in order, the inside on the left; ends on the axis, or
        runs back to its first point where `looped`
    looped : whether the section does not touch the axis
    """

    frame: Floats
    centre: Floats
    profile: Floats
    looped: bool

    def placed(self, points: Floats) -> Floats:
        """Points (n, 3) given along the rows of `frame`, in the surface's own coordinates."""
        return points @ self.frame + self.centre

    def surface(self, segments: int) -> Surface:
        """Outward triangles, each ring of as many points at equal angles, the first along the first axis."""
        angle = np.arange(segments) * (2 * np.pi / segments)
        on_axis = self.profile[:, 0] == 0
        counts = np.where(on_axis, 1, segments)
        starts = np.cumsum(counts) - counts
        rings = [
            np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(segments, height)], 1)[:count]
            for (radius, height), count in zip(self.profile, counts, strict=True)
        ]
        lower = np.arange(len(counts) if self.looped else len(counts) - 1)
        upper = (lower + 1) % len(counts)
        after = np.roll(np.arange(segments), -1)
        corners = [
            (starts[ring] + k * (counts[ring] > 1))
            for ring, k in ((lower[:, None], np.arange(segments)), (lower[:, None], after))
        ] + [
            (starts[ring] + k * (counts[ring] > 1))
            for ring, k in ((upper[:, None], after), (upper[:, None], np.arange(segments)))
        ]
        quads = np.stack(np.broadcast_arrays(*corners), axis=-1).reshape(-1, 4)
        faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        return Surface(self.placed(np.concatenate(rings)), faces[whole])


def revolution_of(surface: Surface) -> Revolution | None:
    """The body of revolution that a closed surface of triangles stands for; None where it is no such body.

    Its vertices lie on rings about one axis, of six or more points each; neighbouring rings are joined, and
    faces around a ring turn by less than `MOST_TURN_DEG`.

    Parameters
    ----------
    surface
        Outward, of one piece, with a bounding box of diagonal 1.
    """
    if not is_closed(surface):
        return None
    axis = _axis_by_moments(surface)
    if axis is None:
        return None
    frame, centre = axis
    ring = _rings((surface.vertices - centre) @ frame.T)
    for _ in range(AXIS_STEPS):
        if ring is None:
            return None
        local = (surface.vertices - centre) @ frame.T
        frame, centre = _nearer(local, ring, frame, centre)
        ring = _rings((surface.vertices - centre) @ frame.T)
    if ring is None:
        return None
    local = (surface.vertices - centre) @ frame.T
    flat = np.stack([np.hypot(local[:, 0], local[:, 1]), local[:, 2]], axis=1)
    size = np.bincount(ring)
    mean = np.stack([np.bincount(ring, flat[:, k]) for k in range(2)], axis=1) / size[:, None]
    if np.abs(flat - mean[ring]).max() > MOST_OFF_RING:
        return None
    mean[mean[:, 0] < MOST_OFF_RING, 0] = 0.0
    order = _order(surface, ring, mean)
    if order is None:
        return None
    rings, looped = order
    gaps = _gaps(local, ring)[rings]
    profile = mean[rings]
    if not looped:  # a flat end has no vertex on the axis
        for end in (0, -1):
            if profile[end, 0] > 0:
                middle = np.array([[0.0, profile[end, 1]]])
                profile = np.concatenate([middle, profile] if end == 0 else [profile, middle])
                gaps = np.concatenate([[0.0], gaps] if end == 0 else [gaps, [0.0]])
    if _signed_area(profile) < 0:
        profile, gaps = profile[::-1].copy(), gaps[::-1].copy()
    body = Revolution(frame, centre, profile, looped)
    return body if _is_round(body, gaps) and _has_measures(body, surface) else None


def _axis_by_moments(surface: Surface) -> tuple[Floats, Floats] | None:
    """Frame and centre by the second moments of the surface, of which two are equal."""
    corner, area = surface.vertices[surface.faces], surface.face_areas
    centre = area @ corner.mean(axis=1) / area.sum()
    corner = corner - centre
    total = corner.sum(axis=1)
    moments = np.einsum("f,fki,fkj->ij", area, corner, corner) + np.einsum("f,fi,fj->ij", area, total, total)
    values, vectors = np.linalg.eigh(moments)
    equal = int(np.argmin(np.diff(values)))
    if values[equal + 1] - values[equal] > EQUAL_MOMENTS * values[-1]:
        return None
    return _frame_about(vectors[:, 2 if equal == 0 else 0]), np.asarray(centre)


def _frame_about(axis: Floats) -> Floats:
    """Right-handed rows, the axis last and up rather than down, the first near to a coordinate axis."""
    axis = axis / np.linalg.norm(axis)
    axis = axis * np.sign(axis[np.abs(axis).argmax()])
    first = np.eye(3)[np.abs(axis).argmin()]
    first = first - (first @ axis) * axis
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis])


def _rings(local: Floats) -> Integers | None:
    """Number of the ring (v,) of each vertex, or None where most have one to themselves."""
    flat = np.stack([np.hypot(local[:, 0], local[:, 1]), local[:, 2]], axis=1)
    # Cells are joined with those next to them, so that no ring is cut by the edge of one.
    cells, cell = np.unique(np.round(flat / RING_SIZE).astype(np.int64), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(1.5, output_type="ndarray")
    graph = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(cells),) * 2)
    count, label = connected_components(graph, directed=False)
    if 4 * count > len(local):
        return None
    return np.asarray(label[cell.reshape(-1)], dtype=np.int64)


def _nearer(local: Floats, ring: Integers, frame: Floats, centre: Floats) -> tuple[Floats, Floats]:
    """Frame and centre moved so that the vertices of each ring differ least in radius and height."""
    radius = np.hypot(local[:, 0], local[:, 1])
    outward = local[:, :2] / np.maximum(radius, 1e-12)[:, None]
    effect = np.zeros((2, len(local), 4))  # of moving the centre along x, y and of tilting the axis by x, y
    effect[0, :, :2], effect[0, :, 2:] = -outward, -outward * local[:, 2:]
    effect[1, :, 2:] = local[:, :2]
    value = np.stack([radius, local[:, 2]])
    size = np.bincount(ring)

    def about_mean(values: Floats) -> Floats:
        return np.asarray(values - (np.bincount(ring, values) / size)[ring])

    matrix = np.stack([[about_mean(row) for row in part.T] for part in effect]).transpose(0, 2, 1)
    right = np.stack([about_mean(row) for row in value])
    off = radius > MOST_OFF_RING
    step = np.linalg.lstsq(matrix[:, off].reshape(-1, 4), -right[:, off].ravel(), rcond=None)[0]
    axis = frame[2] + step[2] * frame[0] + step[3] * frame[1]
    return _frame_about(axis), centre + step[0] * frame[0] + step[1] * frame[1]


def _order(surface: Surface, ring: Integers, mean: Floats) -> tuple[Integers, bool] | None:
    """Rings in the order in which edges join them, and whether the last is joined to the first."""
    ends = np.sort(ring[edge_table(surface.faces).vertices], axis=1)
    joined = np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0)
    degree = np.bincount(joined.ravel(), minlength=len(mean))
    if degree.max() > 2 or degree.min() < 1:
        return None
    last = np.flatnonzero(degree == 1)
    if len(last) not in (0, 2) or np.any(mean[degree == 2, 0] == 0):
        return None
    neighbours: list[list[int]] = [[] for _ in mean]
    for a, b in joined.tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    order = [int(last[0]) if len(last) else 0]
    while True:
        onward = [k for k in neighbours[order[-1]] if len(order) < 2 or k != order[-2]]
        if not onward or onward[0] == order[0]:
            break
        order.append(onward[0])
    if len(order) != len(mean):
        return None
    return np.array(order), len(last) == 0


def _gaps(local: Floats, ring: Integers) -> Floats:
    """Largest angle (ring,) between neighbours on each ring, degrees."""
    angle = np.degrees(np.arctan2(local[:, 1], local[:, 0]))
    order = np.lexsort([angle, ring])
    sorted_ring, sorted_angle = ring[order], angle[order]
    first = np.flatnonzero(np.diff(sorted_ring, prepend=-1))
    last = np.append(first[1:], len(order)) - 1
    gap = np.diff(sorted_angle, append=0.0)
    gap[last] = sorted_angle[first] + 360 - sorted_angle[last]
    return np.maximum.reduceat(gap, first)


def _is_round(body: Revolution, gaps: Floats) -> bool:
    """Whether faces around the axis turn as little as those of a round body."""
    following = np.roll(body.profile, -1, axis=0)
    step = following - body.profile
    turned = np.abs(step[:, 1]) / np.maximum(np.linalg.norm(step, axis=1), 1e-300)
    gap = np.where(body.profile[:, 0] > 0, gaps, 0.0)
    widest = np.maximum(gap, np.roll(gap, -1))
    if not body.looped:
        turned, widest = turned[:-1], widest[:-1]
    return bool(gap.max() <= LARGEST_GAP_DEG and np.max(turned * widest) <= MOST_TURN_DEG)


def _has_measures(body: Revolution, surface: Surface) -> bool:
    """Whether the round body has the area and the volume of the triangles."""
    round_surface = body.surface(64)
    volume, uncertainty = enclosed_volume(surface)
    same_volume = abs(enclosed_volume(round_surface)[0] - volume) <= MOST_DIFFERENCE * volume + uncertainty
    return bool(same_volume and abs(round_surface.area / surface.area - 1) <= MOST_DIFFERENCE)


def _signed_area(polygon: Floats) -> float:
    following = np.roll(polygon, -1, axis=0)
    return float(np.sum(polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]) / 2)
