"""Whether a closed surface has the shape of a can, a jar or a bottle: what its sections along an axis say.

A shape is no proof. A turned block of wood has the sections of a can.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.geometry.solid_properties import solid_properties
from objectfolder.geometry.surface import Surface

Floats = NDArray[np.float64]

SECTIONS = 64
FLAT_END = 0.6
"""Of the largest section: one at a flat base has more. A ball has 0.3 at a twelfth of its height."""

END = 1 / 12
BODY = 0.8
LEAST_BODY = 0.35
NECK = 0.6
LEAST_NECK = 0.05
"""Of the height: how far a neck or cap goes on with hardly changing sections."""

LEAST_ROUNDNESS, LEAST_ROUNDNESS_BELOW_A_NECK = 0.86, 0.7
SLENDERNESS = (0.2, 5.0)


@dataclass(frozen=True)
class ContainerShape:
    """Sections across an axis, of the axis along which they are most a container's.

    Parameters
    ----------
    kind
        ``"can"``, ``"bottle"`` or ``"none"``.
    axis
        Unit vector from base to top.
    slenderness
        Height over the diameter of a circle as large as the largest section.
    base, top
        Largest section within a twelfth of the height of either end, over the largest.
    body
        Share of the height, in one run, with at least 0.8 of the largest section.
    neck
        Share of the height, above the body, of hardly changing sections below 0.6 of the largest.
    roundness
        Median over the body of 4 pi area / perimeter^2: a circle has 1, a square 0.79.
    """

    kind: str
    axis: tuple[float, float, float]
    slenderness: float
    base: float
    top: float
    body: float
    neck: float
    roundness: float


def container_shape(surface: Surface) -> ContainerShape:
    """Find the axis along which a closed surface's sections are most those of a container."""
    inertia = solid_properties(surface.vertices, surface.faces).inertia_per_density_m5
    principal = np.linalg.eigh(inertia)[1].T
    shapes: list[ContainerShape] = []
    for axis in np.concatenate([np.eye(3), principal]):
        area, perimeter = sections(surface, axis)
        height = float(np.ptp(surface.vertices @ axis))
        shapes += [
            _of_sections(axis, height, area, perimeter),
            _of_sections(-axis, height, area[::-1], perimeter[::-1]),
        ]
    return max(shapes, key=lambda shape: (shape.kind != "none", shape.base, shape.body))


def sections(surface: Surface, axis: Floats, count: int = SECTIONS) -> tuple[Floats, Floats]:
    """Area and perimeter (count,) of the sections of a closed surface at even heights along a unit vector.

    The area is the integral along the outline, so that holes and cavities are not counted.
    """
    heights = surface.vertices @ axis
    low, high = heights.min(), heights.max()
    triangles = surface.vertices[surface.faces]
    levels = heights[surface.faces]
    lowest, highest = levels.min(axis=1), levels.max(axis=1)
    area, perimeter = np.zeros(count), np.zeros(count)
    for index in range(count):
        # Never through a vertex of a regular mesh: a level there would cut its edges twice.
        level = low + (high - low) * (index + 0.5 + 1e-4) / count
        cut = (lowest < level) & (highest > level)
        ends = _ends(triangles[cut], levels[cut] - level)
        first, second = ends[:, 0], ends[:, 1]
        along = second - first
        # Outlines run counter-clockwise around the axis: the outside is on the right.
        wanted = np.cross(axis, surface.face_normals[cut])
        turned = np.einsum("ij,ij->i", along, wanted) < 0
        sign = np.where(turned, -1.0, 1.0)
        area[index] = float((sign * (np.cross(first, second) @ axis)).sum()) / 2
        perimeter[index] = float(np.linalg.norm(along, axis=1).sum())
    return np.maximum(area, 0.0), perimeter


def _ends(triangles: Floats, levels: Floats) -> Floats:
    """Where the plane at level 0 cuts two edges of each triangle, (n, 2, 3)."""
    above = levels > 0
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
    row = np.arange(len(triangles))
    ends = []
    for step in (1, 2):
        other = (alone + step) % 3
        share = levels[row, alone] / (levels[row, alone] - levels[row, other])
        corner = triangles[row, alone]
        ends.append(corner + share[:, None] * (triangles[row, other] - corner))
    return np.stack(ends, axis=1)


def _of_sections(axis: Floats, height: float, area: Floats, perimeter: Floats) -> ContainerShape:
    largest = float(area.max())
    if not largest > 0:
        return ContainerShape("none", _triple(axis), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    share = area / largest
    end = max(1, round(END * SECTIONS))
    first, last = _longest_run(share >= BODY)
    roundness = 4 * np.pi * area[first:last] / np.maximum(perimeter[first:last], 1e-300) ** 2
    shape = ContainerShape(
        kind="none",
        axis=_triple(axis),
        slenderness=height / (2 * np.sqrt(largest / np.pi)),
        base=float(share[:end].max()),
        top=float(share[-end:].max()),
        body=(last - first) / SECTIONS,
        neck=_neck(share[last:]) / SECTIONS,
        roundness=float(np.median(roundness)),
    )
    return ContainerShape(**{**shape.__dict__, "kind": _kind(shape)})


def _kind(shape: ContainerShape) -> str:
    least, most = SLENDERNESS
    if shape.base < FLAT_END or shape.body < LEAST_BODY or not least <= shape.slenderness <= most:
        return "none"
    if shape.top >= FLAT_END:
        return "can" if shape.roundness >= LEAST_ROUNDNESS else "none"
    has_neck = shape.neck >= LEAST_NECK
    return "bottle" if has_neck and shape.roundness >= LEAST_ROUNDNESS_BELOW_A_NECK else "none"


def _longest_run(holds: NDArray[np.bool_]) -> tuple[int, int]:
    """First and last but one index of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(np.int8), [0]])))
    runs = edges.reshape(-1, 2)
    first, last = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return int(first), int(last)


def _neck(above: Floats) -> int:
    """How many sections, in one run above the body, are below `NECK` and change by less than a fifth."""
    best = 0
    for start in range(len(above)):
        if not 0.02 < above[start] < NECK:
            continue
        near = np.abs(above[start:] - above[start]) <= 0.2 * above[start]
        best = max(best, len(near) if near.all() else int(np.argmin(near)))
    return best


def _triple(vector: Floats) -> tuple[float, float, float]:
    return (float(vector[0]), float(vector[1]), float(vector[2]))
