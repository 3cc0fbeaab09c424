"""The half section of a thin-walled body of revolution, in triangles across its wall."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import manifold3d
import numpy as np
from numpy.typing import NDArray

from objectfolder.making.solid.revolution import Revolution

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Turns of the profile: at a vertex from which on it is a corner; along one edge at most; of a rim at least;
# of a kink beside a short side, as where a rim is bevelled.
CORNER_TURN, EDGE_TURN, RIM_TURN, KINK_TURN = (math.radians(degrees) for degrees in (35, 62, 75, 12))
RIM_RADIUS = 1.5  # of a rim over the wall, at most
# Stations nearer than this share of an edge are one; walls thicker than that share of an edge are no walls.
NEAR, MOST_ACROSS = 0.3, 0.9
# Quantile of the wall that none counts as less than.
THIN_QUANTILE = 0.05
OPPOSITE_FACING = 0.7  # cosine, at least, between the faces of a wall
SLACK = 1.05
# Longest edge inside the section over the longest allowed: a bulkier body is not cut into such triangles.
MOST_INSIDE = 1.6


@dataclass(frozen=True)
class _Loop:
    """The closed section, counterclockwise: points (n, 2) joined in order, the last to the first.

    Attributes
    ----------
    points : (n, 2)
    across : (n,) wall at the middle of each side, by a ray inwards; infinite where there is none
    allowed : (n,) longest edge at each side
    axis : (n,) bool, sides along the axis
    """

    points: Floats
    across: Floats
    allowed: Floats
    axis: NDArray[np.bool_]

    @property
    def sides(self) -> Floats:
        return np.roll(self.points, -1, axis=0) - self.points


@dataclass(frozen=True)
class HalfSection:
    """Triangles of the half section.

    Attributes
    ----------
    points : (n, 2) radius and height
    triangles : (m, 3) counterclockwise
    edge : (n,) longest edge that the wall there allows
    wall : (n,) thickness there
    """

    points: Floats
    triangles: Integers
    edge: Floats
    wall: Floats


def half_section(body: Revolution, longest_edge: Callable[[Floats], Floats]) -> HalfSection | None:
    """The half section in triangles from wall to wall; None where they would be longer than allowed."""
    loop = _loop(body, longest_edge)
    stations = _stations(loop)
    side = np.minimum(stations.astype(np.int64), len(loop.points) - 1)
    points = _at(loop, stations)
    points[np.abs(points[:, 0]) < 1e-9, 0] = 0.0
    triangles = _delaunay(points)
    edge, wall = loop.allowed[side], loop.across[side]
    at_vertex = stations == side  # between two sides: the thinner wall
    wall = np.where(at_vertex, np.minimum(wall, loop.across[side - 1]), wall)
    corner = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    length = np.linalg.norm(points[corner[:, 0]] - points[corner[:, 1]], axis=1)
    if np.any(length > MOST_INSIDE * edge[corner].max(axis=1)):
        return None
    return HalfSection(points, triangles, edge, wall)


def _loop(body: Revolution, longest_edge: Callable[[Floats], Floats]) -> _Loop:
    points = body.profile
    following = np.roll(points, -1, axis=0)
    side = following - points
    length = np.linalg.norm(side, axis=1)
    axis = (points[:, 0] == 0) & (following[:, 0] == 0)
    inward = np.stack([-side[:, 1], side[:, 0]], axis=1) / length[:, None]
    across = np.array(
        [
            np.inf if axis[k] else _opposite(points, (points[k] + following[k]) / 2, inward[k])[0]
            for k in range(len(points))
        ]
    )
    walls = across[np.isfinite(across)]
    if len(walls):
        across = np.maximum(across, np.quantile(walls, THIN_QUANTILE))  # beside a corner a ray is short
    allowed = longest_edge(across)
    middle = (points + following) / 2
    # No edge is longer than a place near by allows by more than half of the way there.
    away = np.linalg.norm(middle[:, None] - middle[None], axis=2)
    allowed = np.where(axis, np.inf, allowed)
    allowed = (allowed[None] + 0.5 * away).min(axis=1)
    return _Loop(points, across, allowed, axis)


def _opposite(points: Floats, start: Floats, inward: Floats) -> tuple[float, float]:
    """Distance along a ray to the next side that faces away, and where: the side and the share of it."""
    side = np.roll(points, -1, axis=0) - points
    offset = points - start
    cross = inward[0] * side[:, 1] - inward[1] * side[:, 0]
    safe = np.where(np.abs(cross) > 1e-300, cross, np.inf)
    distance = (offset[:, 0] * side[:, 1] - offset[:, 1] * side[:, 0]) / safe
    share = (offset[:, 0] * inward[1] - offset[:, 1] * inward[0]) / safe
    hit = (distance > 1e-9) & (share >= 0) & (share <= 1) & (cross > 0)
    if not hit.any():
        return np.inf, np.nan
    first = int(np.where(hit, distance, np.inf).argmin())
    facing = cross[first] / np.linalg.norm(side[first])
    if facing < OPPOSITE_FACING and not (points[first, 0] == 0 and side[first, 0] == 0):
        return np.inf, np.nan
    return float(distance[first]), first + min(float(share[first]), 1 - 1e-9)


def _at(loop: _Loop, stations: Floats) -> Floats:
    """Points (n, 2) at places given as side plus share of it."""
    side = np.minimum(stations.astype(np.int64), len(loop.points) - 1)
    return loop.points[side] + (stations - side)[:, None] * loop.sides[side]


def _stations(loop: _Loop) -> Floats:
    """Places of the section's vertices along the loop, ascending: corners, rims, and between them evenly."""
    side, count = loop.sides, len(loop.points)
    length = np.linalg.norm(side, axis=1)
    direction = np.arctan2(side[:, 1], side[:, 0])
    turn = np.angle(np.exp(1j * (direction - np.roll(direction, 1))))
    along = np.concatenate([[0.0], np.cumsum(length)])
    is_corner = (np.abs(turn) > CORNER_TURN) | (loop.axis != np.roll(loop.axis, 1))
    smooth = np.where(is_corner, 0.0, np.abs(turn))
    need = np.maximum(
        np.where(np.isfinite(loop.allowed), length / loop.allowed, 0.0),
        (smooth + np.roll(smooth, -1)) / 2 / EDGE_TURN,
    )
    total = np.concatenate([[0.0], np.cumsum(need)])

    def distance(place: float) -> float:
        k = min(int(place), count - 1)
        return float(along[k] + (place - k) * length[k])

    def added(places: list[float], new: float) -> bool:
        """Add a place and the one across the wall, unless they are near to others."""
        k = min(int(new), count - 1)
        near = NEAR * loop.allowed[k]
        apart = [abs(distance(new) - distance(old)) for old in places]
        if any(min(gap, along[-1] - gap) < near for gap in apart):
            return False
        places.append(new)
        return True

    def mirrored(places: list[float], new: float) -> None:
        k = min(int(new), count - 1)
        if loop.axis[k]:
            return
        inward = np.array([-side[k, 1], side[k, 0]]) / length[k]
        if new == k and not is_corner[k]:  # at a vertex of a smooth profile: the mean of both sides
            before = np.array([-side[k - 1, 1], side[k - 1, 0]]) / length[k - 1]
            inward = (inward + before) / np.linalg.norm(inward + before)
        away, place = _opposite(loop.points, _at(loop, np.array([new]))[0], inward)
        if away < MOST_ACROSS * loop.allowed[k]:
            added(places, place)

    fixed = [float(k) for k in np.flatnonzero(is_corner)] + _rims(loop, turn, is_corner, length)
    places = sorted(set(fixed)) or [0.0]
    for place in list(places):
        mirrored(places, place)
    while True:
        places.sort()
        ends = [*places[1:], places[0] + count]
        needs = [_between(total, first, last, count) for first, last in zip(places, ends, strict=True)]
        widest = int(np.argmax(needs))
        parts = math.ceil(needs[widest] / SLACK)
        if parts < 2:
            return np.array(places)
        start = float(np.interp(places[widest], np.arange(count + 1), total))
        for part in range(1, parts):
            station = (start + part * needs[widest] / parts) % total[-1]
            new = min(float(np.interp(station, total, np.arange(count + 1))), count - 1e-9)
            places.append(new)
            mirrored(places, new)


def _between(total: Floats, first: float, last: float, count: int) -> float:
    """Edges needed between two places, the second of which may be one round further."""
    place = np.arange(count + 1)
    before = float(np.interp(first, place, total))
    after = float(np.interp(last, place, total)) if last <= count else (
        total[-1] + float(np.interp(last - count, place, total))
    )  # fmt: skip
    return after - before


def _rims(loop: _Loop, turn: Floats, is_corner: NDArray[np.bool_], length: Floats) -> list[float]:
    """Places of rounded rims: their ends, and evenly between them."""
    finite = loop.across[np.isfinite(loop.across)]
    if len(finite) == 0:
        return []
    count = len(turn)
    radius = (length + np.roll(length, 1)) / 2 / np.maximum(np.abs(turn), 1e-12)
    wall = float(np.quantile(finite, 0.1))
    tight = (radius < RIM_RADIUS * wall) & (turn > 0) & ~is_corner
    short = np.minimum(length, np.roll(length, 1)) < wall
    kink = (np.abs(turn) > KINK_TURN) & short & ~is_corner
    if tight.all():
        return []
    places: list[float] = []
    for first in np.flatnonzero(tight & ~np.roll(tight, 1)):
        last = first
        while tight[(last + 1) % count]:
            last += 1
        inner = np.arange(first, last + 1)
        turned = np.cumsum(turn[inner % count])
        if turned[-1] < RIM_TURN:
            continue
        kink[np.arange(first - 1, last + 2) % count] = False
        parts = math.ceil(turned[-1] / EDGE_TURN)
        angles = np.linspace(0, turned[-1], parts + 1)
        # A vertex each: its turn is taken as spread evenly over the sides beside it.
        middle = np.concatenate([[0.0], turned])
        where = np.interp(angles, middle, np.arange(first, last + 2) - 0.5)
        places += [float(np.round(place)) % count for place in where]
    return places + [float(k) for k in np.flatnonzero(kink)]


def _delaunay(points: Floats) -> Integers:
    """Triangles (m, 3) of a simple polygon, edges turned until no corner lies in another's circle."""
    triangles = [tuple(int(k) for k in row) for row in manifold3d.triangulate([points])]
    count = len(points)
    for _ in range(count * count):
        of_edge = {
            (row[k], row[(k + 1) % 3]): (place, row[(k + 2) % 3])
            for place, row in enumerate(triangles)
            for k in range(3)
        }
        for (a, b), (near, c) in of_edge.items():
            if (b, a) in of_edge and _in_circle(points[[a, b, c]], points[of_edge[b, a][1]]):
                far, d = of_edge[b, a]
                if min(_twice_area(points[[a, d, c]]), _twice_area(points[[d, b, c]])) > 0:
                    triangles[near], triangles[far] = (a, d, c), (d, b, c)
                    break
        else:
            break
    return np.array(triangles, dtype=np.int64)


def _twice_area(corner: Floats) -> float:
    (ax, ay), (bx, by), (cx, cy) = corner
    return float((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


def _in_circle(corner: Floats, point: Floats) -> bool:
    """Whether a point lies in the circle through a counterclockwise triangle, by more than rounding."""
    moved = corner - point
    matrix = np.column_stack([moved, np.sum(moved**2, axis=1)])
    return bool(np.linalg.det(matrix) > 1e-9 * float(np.abs(moved).max()) ** 4)
