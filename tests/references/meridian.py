"""Meridians of bodies of revolution: areas of the (r, z) half plane in curved quadrilaterals."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Map = Callable[[Floats, Floats], Floats]
# Largest turn between points of an outline, radians.
TURN = 0.5


@dataclass(frozen=True)
class Block:
    """A curved quadrilateral of the meridian, one element.

    Attributes
    ----------
    position : map of (s, t) in [0, 1]^2, any one shape, to (..., 2) of r and z; smooth up to the sides. A
        side may be shrunk to a point.
    along : whether s runs along a wall and needs the higher order
    """

    position: Map
    along: bool


@dataclass(frozen=True)
class Meridian:
    """A body of revolution about r = 0.

    Attributes
    ----------
    name : of the body
    blocks : elements; two share a whole side or nothing
    outline : function of a largest step, metres, giving points (n, 2) of the boundary, r and z, from the
        lower end on the axis to the upper end, closer where it turns
    """

    name: str
    blocks: tuple[Block, ...]
    outline: Callable[[float], Floats]


@dataclass(frozen=True)
class Path:
    """Curve of lines and arcs that join smoothly, starting outward from the axis.

    Attributes
    ----------
    start : r and z
    pieces : (length, turn) of each, metres and radians; a positive turn is to the left (upward at first)
    """

    start: tuple[float, float]
    pieces: tuple[tuple[float, float], ...]

    @property
    def knots(self) -> Floats:
        """Distances along the curve at which pieces end, (pieces + 1,)."""
        return np.cumsum([0.0] + [length for length, _ in self.pieces])

    def frame(self, distance: Floats, piece: int) -> tuple[Floats, Floats, Floats]:
        """Point, unit tangent and left normal (..., 2) at distances within one piece."""
        begin, direction = np.array(self.start, dtype=np.float64), 0.0
        for length, turn in self.pieces[:piece]:
            begin = begin + _chord(np.array(length), length, turn, direction)
            direction += turn
        length, turn = self.pieces[piece]
        local = distance - self.knots[piece]
        angle = direction + turn * local / length
        tangent = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        normal = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
        return begin + _chord(local, length, turn, direction), tangent, normal


def _chord(local: Floats, length: float, turn: float, direction: float) -> Floats:
    """From the start of a piece to the point `local` along it: length sinc(half the angle), half turned."""
    half = turn * local / length / 2
    reach = local * np.sinc(half / np.pi)
    return np.stack([reach * np.cos(direction + half), reach * np.sin(direction + half)], axis=-1)


@dataclass(frozen=True)
class Wall:
    """What lies between two offsets of a path.

    Attributes
    ----------
    path : from the axis to the rim
    below, above : thickness on the right and on the left of the path at distances along it, metres; smooth
        within each piece between `cuts` and continuous
    cuts : further distances at which an element ends
    element : longest element along the path, metres
    """

    path: Path
    below: Callable[[Floats], Floats]
    above: Callable[[Floats], Floats]
    cuts: tuple[float, ...]
    element: float

    def at(self, distance: Floats, across: Floats, piece: int) -> Floats:
        """Point (..., 2): across is 0 on the lower and 1 on the upper face."""
        point, _, normal = self.path.frame(distance, piece)
        height = (1 - across) * -self.below(distance) + across * self.above(distance)
        return point + height[..., None] * normal

    def intervals(self) -> list[tuple[float, float, int]]:
        """Ends and piece of the path of each element."""
        knots = self.path.knots
        ends = np.unique(np.concatenate([knots, self.cuts]))
        result = []
        for first, last in pairwise(ends):
            if last - first < 1e-9 * knots[-1]:
                continue
            parts = np.linspace(first, last, int(np.ceil((last - first) / self.element)) + 1)
            piece = int(np.searchsorted(knots, (first + last) / 2) - 1)
            result += [(a, b, piece) for a, b in pairwise(parts)]
        return result

    def meridian(self, name: str, *, round_rim: bool = True) -> Meridian:
        """The wall, ending in a half circle or cut straight across the path."""
        intervals = self.intervals()
        blocks = [Block(self._block(*interval), True) for interval in intervals]
        end, last = np.array(self.path.knots[-1]), len(self.path.pieces) - 1
        lower, upper = (self.at(end, np.array(side), last) for side in (0.0, 1.0))
        if round_rim:
            blocks += [Block(position, False) for position in half_disc(lower, upper)]

        def outline(step: float) -> Floats:
            faces = []
            for side in (0.0, 1.0):
                points = [self.at(np.zeros(1), np.full(1, side), 0)]
                for first, final, piece in intervals:
                    fine = self.at(np.linspace(first, final, 129), np.full(129, side), piece)
                    points.append(_even(fine, step)[1:])
                faces.append(np.concatenate(points))
            if round_rim:
                rim = _even(arc(lower, upper, np.linspace(0, 1, 257)), step)[1:-1]
            else:
                rim = _even(np.linspace(lower, upper, 257), step)[1:-1]
            points = np.concatenate([faces[0], rim, faces[1][::-1]])
            points[[0, -1], 0] = 0.0
            return points

        return Meridian(name, tuple(blocks), outline)

    def _block(self, first: float, last: float, piece: int) -> Map:
        return lambda s, t: self.at(first + (last - first) * s, t, piece)


def arc(lower: Floats, upper: Floats, share: Floats) -> Floats:
    """Half circle from `lower` to `upper`, on the right of the way there, (..., 2) for shares in [0, 1]."""
    centre, across = (lower + upper) / 2, (upper - lower) / 2
    outward = np.array([across[1], -across[0]])
    angle = np.pi * (share - 0.5)
    return centre + np.sin(angle)[..., None] * across + np.cos(angle)[..., None] * outward


def half_disc(lower: Floats, upper: Floats) -> list[Map]:
    """Blocks of a half disc on the right of its diameter from `lower` to `upper`, which is a side of one.

    A trapezium on the diameter, a block against the middle half of the arc, and on each side a block whose
    fourth side is shrunk to the end of the diameter.
    """
    centre, across = (lower + upper) / 2, (upper - lower) / 2
    outward = np.array([across[1], -across[0]])
    corner = {side: centre + 0.45 * side * across + 0.5 * outward for side in (-1, 1)}

    def between(first: Map, last: Map) -> Map:
        return lambda s, t: (1 - s)[..., None] * first(s, t) + s[..., None] * last(s, t)

    def line(start: Floats, end: Floats) -> Map:
        return lambda s, t: start + t[..., None] * (end - start)

    def part(start: float, end: float) -> Map:
        return lambda s, t: arc(lower, upper, start + t * (end - start))

    return [
        between(line(lower, upper), line(corner[-1], corner[1])),
        between(line(corner[-1], corner[1]), part(0.25, 0.75)),
        between(line(lower, corner[-1]), part(0.0, 0.25)),
        between(line(corner[1], upper), part(0.75, 1.0)),
    ]


def _even(points: Floats, step: float) -> Floats:
    """Points of a dense curve, the ends included: at most `step` and, but for corners, `TURN` apart."""
    difference = np.diff(points, axis=0)
    angle = np.unwrap(np.arctan2(difference[:, 1], difference[:, 0]))
    turned = np.abs(np.concatenate([[0.0], np.diff(angle)]))
    need = np.maximum(np.linalg.norm(difference, axis=1) / step, turned / TURN)
    total = np.concatenate([[0.0], np.cumsum(need)])
    count = max(1, int(np.ceil(total[-1] - 1e-9)))
    index = np.searchsorted(total, np.linspace(0, total[-1], count + 1)[1:-1])
    return points[np.concatenate([[0], index, [len(points) - 1]]).astype(np.int64)]
