"""Whether a closed surface has the shape of a can, a jar or a bottle: what its sections along an axis say.

A shape is no proof. A turned block of wood has the sections of a can.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from objectfolder.mesh.solid_properties import solid_properties
from objectfolder.surface.surface import Surface

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

LEAST_ROUNDNESS, LEAST_ROUNDNESS_BELOW_A_NECK, LEAST_ROUNDNESS_OF_A_NECK = 0.86, 0.8, 0.8
SLENDERNESS = (0.2, 5.0)
MOST_BEND = 0.25
"""How far, in radii of the body, the middles of its sections may leave their mean."""

SMALLEST_M = 0.02
"""Of the diameter of a body: smaller things are dice and beads."""

DECIMALS = 6
"""Of what is said and compared: axes of symmetric bodies tie but for rounding, which differs by processor."""


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
    diameter_m
        Of that circle, metres.
    base, top
        Largest section within a twelfth of the height of either end, over the largest: by its convex hull,
        for the ends of cans lie deeper than their rims.
    body
        Share of the height, in one run, with at least 0.8 of the largest section.
    neck
        Share of the height, above the body, of hardly changing sections below 0.6 of the largest.
    roundness, neck_roundness
        Median over the body and the neck of 4 pi area / perimeter^2: a circle has 1, a square 0.79.
    bend
        Largest distance of the middle of a section of the body from their mean, in radii.
    """

    kind: str
    axis: tuple[float, float, float]
    slenderness: float
    diameter_m: float
    base: float
    top: float
    body: float
    neck: float
    roundness: float
    neck_roundness: float
    bend: float


@dataclass(frozen=True)
class Sections:
    """Sections at even heights along an axis.

    Parameters
    ----------
    area, perimeter
        (n,) metres; the area by the integral along the outline, so that holes and cavities are not counted.
    middle
        (n, 3) centroids; zero where there is no section.
    hull
        (n,) areas of the convex hulls of the sections within `END` of either end, elsewhere the areas.
    """

    area: Floats
    perimeter: Floats
    middle: Floats
    hull: Floats

    def reversed(self) -> "Sections":
        """Return them from the other end."""
        return Sections(self.area[::-1], self.perimeter[::-1], self.middle[::-1], self.hull[::-1])


def container_shape(surface: Surface) -> ContainerShape:
    """Find the axis along which a closed surface's sections are most those of a container."""
    inertia = solid_properties(surface.vertices, surface.faces).inertia_per_density_m5
    principal = np.linalg.eigh(inertia)[1].T
    shapes: list[ContainerShape] = []
    for axis in np.concatenate([np.eye(3), principal]):
        across = sections(surface, axis)
        height = float(np.ptp(surface.vertices @ axis))
        shapes += [_of_sections(axis, height, across), _of_sections(-axis, height, across.reversed())]
    return max(shapes, key=lambda shape: (shape.kind != "none", shape.base, shape.body))


def sections(surface: Surface, axis: Floats, count: int = SECTIONS) -> Sections:
    """Cut a closed surface, of some extent along a unit vector, at even heights along it."""
    heights = surface.vertices @ axis
    low, step = heights.min(), np.ptp(heights) / count
    levels = heights[surface.faces]
    # Never through a vertex of a regular mesh: a level there would cut its edges twice.
    offset = 0.5 + 1e-4
    first = np.floor((levels.min(axis=1) - low) / step - offset).astype(np.int64) + 1
    last = np.ceil((levels.max(axis=1) - low) / step - offset).astype(np.int64) - 1
    cuts = np.maximum(np.minimum(last, count - 1) - np.maximum(first, 0) + 1, 0)
    face = np.repeat(np.arange(len(cuts)), cuts)
    index = np.arange(len(face)) - np.repeat(np.cumsum(cuts) - cuts, cuts) + np.maximum(first, 0)[face]
    relative = levels[face] - (low + (index + offset) * step)[:, None]
    cut = (relative.min(axis=1) < 0) & (relative.max(axis=1) > 0)
    face, index, relative = face[cut], index[cut], relative[cut]
    ends = _ends(surface.vertices[surface.faces[face]], relative)
    along = ends[:, 1] - ends[:, 0]
    # Outlines run counter-clockwise around the axis: the outside is on the right.
    turned = np.einsum("ij,ij->i", along, np.cross(axis, surface.face_normals[face])) < 0
    parts = np.where(turned, -0.5, 0.5) * (np.cross(ends[:, 0], ends[:, 1]) @ axis)
    perimeter: Floats = np.bincount(index, np.linalg.norm(along, axis=1), count).astype(np.float64)
    area = np.maximum(np.bincount(index, parts, count), 0.0)
    weighted = parts[:, None] * ends.sum(axis=1) / 3
    moment = np.stack([np.bincount(index, weighted[:, k], count) for k in range(3)], axis=1)
    middle = np.where(area[:, None] > 0, moment / np.where(area > 0, area, 1.0)[:, None], 0.0)
    # What runs along the axis is no middle of a section.
    middle -= np.outer(middle @ axis, axis)
    hull = area.copy()
    for level in (*range(_end(count)), *range(count - _end(count), count)):
        hull[level] = max(hull[level], _hull_area(ends[index == level].reshape(-1, 3), axis))
    return Sections(area, perimeter, middle, hull)


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


def _end(count: int) -> int:
    return max(1, round(END * count))


def _hull_area(points: Floats, axis: Floats) -> float:
    """Area of the convex hull of points of a plane across an axis; 0 for points on a line."""
    if len(points) < 3:
        return 0.0
    basis = np.linalg.svd(axis[None])[2][1:]
    try:
        return float(ConvexHull(points @ basis.T).volume)
    except QhullError:
        return 0.0


def _of_sections(axis: Floats, height: float, across: Sections) -> ContainerShape:
    largest = float(across.area.max())
    if not largest > 0:
        return ContainerShape("none", _triple(axis), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    share = across.area / largest
    end = _end(len(share))
    diameter = 2 * float(np.sqrt(largest / np.pi))
    first, last = _longest_run(share >= BODY)
    neck_first, neck_last = _neck(share, last)
    # Between pieces there is no section, and none is round.
    roundness = 4 * np.pi * across.area / np.where(across.perimeter > 0, across.perimeter, np.inf) ** 2
    middle = across.middle[first:last]
    shape = ContainerShape(
        kind="none",
        axis=_triple(axis),
        slenderness=_rounded(height / diameter),
        diameter_m=_rounded(diameter),
        base=_rounded(across.hull[:end].max() / largest),
        top=_rounded(across.hull[-end:].max() / largest),
        body=(last - first) / len(share),
        neck=(neck_last - neck_first) / len(share),
        roundness=_rounded(np.median(roundness[first:last])),
        neck_roundness=_rounded(np.median(roundness[neck_first:neck_last]))
        if neck_last > neck_first
        else 0.0,
        bend=_rounded(np.linalg.norm(middle - middle.mean(axis=0), axis=1).max() / (diameter / 2)),
    )
    return replace(shape, kind=_kind(shape))


def _kind(shape: ContainerShape) -> str:
    least, most = SLENDERNESS
    if shape.base < FLAT_END or shape.body < LEAST_BODY or not least <= shape.slenderness <= most:
        return "none"
    if shape.diameter_m < SMALLEST_M or shape.bend > MOST_BEND:
        return "none"
    if shape.top >= FLAT_END:
        return "can" if shape.roundness >= LEAST_ROUNDNESS else "none"
    has_neck = shape.neck >= LEAST_NECK and shape.neck_roundness >= LEAST_ROUNDNESS_OF_A_NECK
    return "bottle" if has_neck and shape.roundness >= LEAST_ROUNDNESS_BELOW_A_NECK else "none"


def _longest_run(holds: NDArray[np.bool_]) -> tuple[int, int]:
    """First and last but one index of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(np.int8), [0]])))
    runs = edges.reshape(-1, 2)
    first, last = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return int(first), int(last)


def _neck(share: Floats, body_ends: int) -> tuple[int, int]:
    """First and last but one of the longest run, above the body, of hardly changing sections below `NECK`."""
    best = (body_ends, body_ends)
    for start in range(body_ends, len(share)):
        if not 0.02 < share[start] < NECK:
            continue
        near = np.abs(share[start:] - share[start]) <= 0.2 * share[start]
        length = len(near) if near.all() else int(np.argmin(near))
        if length > best[1] - best[0]:
            best = (start, start + length)
    return best


def _triple(vector: Floats) -> tuple[float, float, float]:
    return (_rounded(vector[0]), _rounded(vector[1]), _rounded(vector[2]))


def _rounded(value: float) -> float:
    return round(float(value), DECIMALS) + 0.0  # zero has no sign
