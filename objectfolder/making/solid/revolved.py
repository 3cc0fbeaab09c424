"""Thin-walled bodies of revolution in tetrahedra that repeat around the axis.

The triangles of the half section (`half_section`) are turned about the axis in equal steps. The prisms are
cut in three by the order of their corners, which is the same all around. So the elements are turned into
themselves, and the two modes of a pair have one frequency. Towards the axis, and where walls carry longer
waves, there are half as many steps; between the two rows a step is cut through its middle.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from objectfolder.making.solid.half_section import SLACK, HalfSection, half_section
from objectfolder.making.solid.normal_form import NormalForm
from objectfolder.making.solid.revolution import Revolution, revolution_of
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Least number of steps around the axis; height of an arc over the wall at most.
LEAST_AROUND, MOST_ARC_HEIGHT = 6, 0.3
LEAST_SEGMENTS = 144  # of the round surface
# Shares of the edges allowed, as all are as long and their diagonals longer: the first with few elements,
# or the last.
EVEN_EDGES, FEW_ELEMENTS = (0.6, 0.75, 0.9), 1700


@dataclass(frozen=True)
class Revolved:
    """A thin-walled body of revolution.

    Attributes
    ----------
    surface : the round surface that it stands for, metres, outward
    vertices : (v, 3) metres
    tetrahedra : (t, 4) in either orientation
    steps : elements around the axis, at most
    sectors : how many equal sectors a whole turn is made of
    axis : (2, 3) a point on it, metres, and its direction
    """

    surface: Surface
    vertices: Floats
    tetrahedra: Integers
    steps: int
    sectors: int
    axis: Floats


def revolved(form: NormalForm, longest_edge: Callable[[Floats], Floats]) -> Revolved | None:
    """A surface's body where it is one of revolution with thin walls; see `revolved_walls`."""
    body = revolution_of(form.surface)
    if body is None:
        return None
    walls = None
    for share in EVEN_EDGES:
        walls = revolved_walls(body, partial(_shorter, longest_edge, share)) or walls
        if walls is not None and len(walls[1]) <= FEW_ELEMENTS:
            break
    if walls is None:
        return None
    vertices, tetrahedra, steps, sectors = walls
    surface = body.surface(steps * max(4, math.ceil(LEAST_SEGMENTS / steps)))
    in_metres = Surface(form.to_metres(surface.vertices), surface.faces)
    axis = np.stack([form.to_metres(body.centre), body.frame[2]])
    return Revolved(in_metres, form.to_metres(vertices), tetrahedra, steps, sectors, axis)


def _shorter(longest_edge: Callable[[Floats], Floats], share: float, wall: Floats) -> Floats:
    return share * longest_edge(wall)


def revolved_walls(
    body: Revolution, longest_edge: Callable[[Floats], Floats]
) -> tuple[Floats, Integers, int, int] | None:
    """Tetrahedra of a thin-walled body of revolution; None where it is too bulky for one layer of elements.

    Parameters
    ----------
    body
        In the unit of its profile.
    longest_edge
        Longest edge (n,) of elements in walls of thicknesses (n,), which may be infinite.

    Returns
    -------
    vertices, tetrahedra, steps, sectors
        (v, 3), (t, 4), the largest number of elements around the axis, and the least off it.
    """
    section = half_section(body, longest_edge)
    if section is None:
        return None
    levels, counts = _levels(section)
    vertices, tetrahedra = _turned(section, levels, counts)
    off_axis = section.points[:, 0] > 0
    around = counts[levels[off_axis]]
    return body.placed(vertices), tetrahedra, int(around.max()), int(around.min())


def _levels(section: HalfSection) -> tuple[Integers, Integers]:
    """Level (n,) of each vertex, and the steps around the axis at each level, twice as many each time."""
    radius = section.points[:, 0]
    off = radius > 0
    arc = MOST_ARC_HEIGHT * np.minimum(np.where(off, section.wall, 1.0) / np.where(off, radius, 1.0), 1.0)
    needed = np.maximum(2 * np.pi * radius / (SLACK * section.edge), np.pi / np.arccos(1 - arc))
    most = max(float(needed.max()), LEAST_AROUND)
    depth = math.floor(math.log2(most / LEAST_AROUND))
    # An odd number of sectors: of an even one, elements tell apart the two modes of half that order.
    counts = (math.ceil(most / 2**depth) | 1) * 2 ** np.arange(depth + 1)
    levels = np.minimum(np.searchsorted(counts, needed - 1e-9), depth)
    levels[radius == 0] = 0
    while True:
        steps = np.where(radius[section.triangles] > 0, levels[section.triangles], -1)
        lowest = np.maximum(steps.max(axis=1, keepdims=True) - 1, 0)
        raised = levels.copy()
        np.maximum.at(raised, section.triangles.ravel(), np.repeat(lowest.ravel(), 3))
        raised[radius == 0] = 0
        if np.array_equal(raised, levels):
            return levels, counts
        levels = raised


def _turned(section: HalfSection, levels: Integers, counts: Integers) -> tuple[Floats, Integers]:
    """Vertices (v, 3) about the third axis and tetrahedra (t, 4)."""
    on_axis = section.points[:, 0] == 0
    around = np.where(on_axis, 1, counts[levels])
    starts = np.cumsum(around) - around
    point = np.repeat(np.arange(len(around)), around)
    angle = (np.arange(len(point)) - starts[point]) * (2 * np.pi / around[point])
    radius, height = section.points[point].T
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)

    def number(vertex: int, step: int) -> int:
        return int(starts[vertex] + step % around[vertex])

    tetrahedra: list[tuple[int, ...]] = []
    for triangle in section.triangles.tolist():
        corners = sorted(triangle)
        off = [k for k in corners if not on_axis[k]]
        lowest = min(int(levels[k]) for k in off)
        fine = [k for k in off if levels[k] > lowest]
        for step in range(int(counts[lowest])):
            tetrahedra += _cell(corners, fine, step, number)
    table = np.array(tetrahedra, dtype=np.int64)
    ordered = np.sort(table, axis=1)
    return vertices, table[(np.diff(ordered, axis=1) > 0).all(axis=1)]


def _cell(
    corners: list[int], fine: list[int], step: int, number: Callable[[int, int], int]
) -> list[tuple[int, ...]]:
    """Tetrahedra of one step of a triangle; `fine` are the corners that have twice as many steps.

    The diagonal of a side goes from its lower corner to the next place of its higher one. A side between a
    coarse and a fine corner is a fan about the middle of the fine one.
    """

    def end(vertex: int, ahead: int) -> int:
        return number(vertex, 2 * (step + ahead) if vertex in fine else step + ahead)

    first, last = ([end(k, ahead) for k in corners] for ahead in (0, 1))
    if not fine:
        (a, b, c), (d, e, f) = first, last
        return [(a, b, c, f), (a, b, e, f), (a, d, e, f)]
    middle = [number(k, 2 * step + 1) for k in fine]
    if len(fine) == 1:
        top = middle[0]
        low, high = (k for k in corners if k not in fine)
        diagonal = (end(low, 0), end(high, 1))
        sides = [(*diagonal, end(high, 0)), (*diagonal, end(low, 1))]
        return [(top, *first), (top, *last), *((top, *side) for side in sides)]
    coarse = next(k for k in corners if k not in fine)
    (a, b), (m, n) = (end(coarse, 0), end(coarse, 1)), middle
    (c, e), (d, f) = ((end(k, 0), end(k, 1)) for k in fine)
    return [(a, c, d, n), (a, c, m, n), (a, b, m, n), (b, m, n, f), (b, m, f, e)]
