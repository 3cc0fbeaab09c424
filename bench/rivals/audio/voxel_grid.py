"""A surface as a grid of cubes: those that meet it or lie inside, or those whose centre is inside.

The papers name a voxel grid and no rule; the rules here span what voxelisers do.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import InputError
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
RULES = ("touch", "samples", "centre")
SAMPLES = 4
# Cubes are open by this share of their edge: a face of the surface in a face of the grid meets neither side.
OPEN = 1e-9
# Rays pass cell centres this far aside, in edges, so that they miss the vertices of regular meshes.
ASIDE = (1.3e-7, 0.7e-7)
PAIRS = 2_000_000


@dataclass(frozen=True)
class VoxelGrid:
    """Equal cubes, some of them full.

    Attributes
    ----------
    origin_m : (3,) float64, lowest corner of cell (0, 0, 0)
    edge_m : edge of a cell
    full : (nx, ny, nz) bool
    """

    origin_m: Floats
    edge_m: float
    full: NDArray[np.bool_]


def voxelise(surface: Surface, resolution: int, rule: str) -> VoxelGrid:
    """Grid with `resolution` cubes along the longest side of the bounding box, from its lowest corner.

    Parameters
    ----------
    surface
        Metres, faces outward; need not be closed.
    rule
        ``touch``: cubes whose interior meets the surface, or whose centre is inside. ``samples``: cubes with
        any of 4 x 4 x 4 evenly spaced points inside. ``centre``: cubes whose centre is inside. Inside is
        where most of the six rays along the axes leave the surface more often than they enter it, so that
        holes of a scan do little harm.

    Raises
    ------
    InputError
        An unknown rule, a resolution below 1, a surface without extent, or one that fills no cube.
    """
    if rule not in RULES:
        raise InputError("rule", f"{rule!r}", f"Choose one of {', '.join(RULES)}.")
    if resolution < 1:
        raise InputError("resolution", str(resolution), "Give at least 1 cell.")
    lowest, highest = surface.bounds
    edge = float((highest - lowest).max()) / resolution
    if edge <= 0:
        raise InputError("surface", "no extent", "Check the mesh.")
    counts = np.maximum(np.ceil((highest - lowest) / edge - 1e-6), 1).astype(np.int64)
    triangles = (surface.vertices - lowest)[surface.faces] / edge
    if rule == "samples":
        fine = _inside(triangles * SAMPLES, surface.faces, counts * SAMPLES)
        x, y, z = counts
        full = fine.reshape(x, SAMPLES, y, SAMPLES, z, SAMPLES).any(axis=(1, 3, 5))
    else:
        full = _inside(triangles, surface.faces, counts)
    if rule == "touch":
        full |= _touched(triangles, counts)
    if not full.any():
        raise InputError(
            "surface", f"no cube of {edge:.3g} m by rule {rule!r}", "Take rule touch or more cells."
        )
    return VoxelGrid(lowest.astype(np.float64), edge, full)


def _touched(triangles: Floats, counts: Integers) -> NDArray[np.bool_]:
    """Cells (nx, ny, nz) whose interior meets a triangle; coordinates in cells.

    By separating axes: T. Akenine-Moller, "Fast 3D triangle-box overlap testing", 2001.
    """
    touched = np.zeros(counts, dtype=bool)
    first = np.clip(np.floor(triangles.min(axis=1)), 0, counts - 1).astype(np.int64)
    last = np.clip(np.ceil(triangles.max(axis=1)) - 1, first, counts - 1).astype(np.int64)
    spans = last - first + 1
    for triangle, offset in _pairs(spans):
        cell = first[triangle] + offset
        corners = triangles[triangle] - (cell[:, None] + 0.5)
        sides = np.roll(corners, -1, axis=1) - corners
        overlap = np.ones(len(cell), dtype=bool)
        axes = [np.broadcast_to(row, (len(cell), 3)) for row in np.eye(3)]
        axes.append(np.cross(sides[:, 0], sides[:, 1]))
        axes += [np.cross(row, sides[:, k]) for row in np.eye(3) for k in range(3)]
        for axis in axes:
            along = np.einsum("nkc,nc->nk", corners, axis)
            reach = (0.5 - OPEN) * np.abs(axis).sum(axis=1)
            overlap &= (along.min(axis=1) <= reach) & (along.max(axis=1) >= -reach)
        touched[tuple(cell[overlap].T)] = True
    return touched


def _inside(triangles: Floats, faces: Integers, counts: Integers) -> NDArray[np.bool_]:
    """Cells (nx, ny, nz) whose centre most of the six rays along the axes call inside."""
    votes = np.zeros(counts, dtype=np.int64)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        leaving = _crossings(triangles[:, :, [u, v, axis]], faces, counts[[u, v, axis]])
        upward = np.cumsum(leaving[:, :, ::-1], axis=2)[:, :, ::-1]  # crossings at or above each height
        above, total = upward[:, :, 1:], upward[:, :, :1]
        inside = (above > 0).astype(np.int64) + (above - total > 0)
        votes += np.transpose(inside, np.argsort([u, v, axis]))
    return votes >= 4


def _crossings(triangles: Floats, faces: Integers, counts: Integers) -> Integers:
    """Signed crossings of rays along the third axis through cell centres, (nu, nv, heights + 1).

    Entry k counts crossings that lie above the centres of cells 0 .. k - 1 alone: +1 where a ray upward
    leaves, -1 where it enters. The side of an edge on which a ray passes is decided from the edge's
    vertices in a fixed order, so that the two faces of an edge agree and a ray crosses one of them.
    """
    crossings = np.zeros(counts + np.array([0, 0, 1]), dtype=np.int64)
    flat = triangles[:, :, :2] - 0.5 - np.array(ASIDE)
    first = np.maximum(np.ceil(flat.min(axis=1)), 0).astype(np.int64)
    last = np.minimum(np.floor(flat.max(axis=1)), counts[:2] - 1).astype(np.int64)
    spans = np.maximum(last - first + 1, 0)
    for triangle, offset in _pairs(np.concatenate([spans, np.ones((len(spans), 1), dtype=np.int64)], axis=1)):
        column = first[triangle] + offset[:, :2]
        corners = flat[triangle] - column[:, None]
        name = faces[triangle]
        weights = np.empty((len(column), 3))
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            swap = name[:, a] > name[:, b]
            p = np.where(swap[:, None], corners[:, b], corners[:, a])
            q = np.where(swap[:, None], corners[:, a], corners[:, b])
            area = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
            weights[:, k] = np.where(swap, -1.0, 1.0) * np.where(area == 0, 1e-300, area)
        hit = (weights > 0).all(axis=1) | (weights < 0).all(axis=1)
        weights, column, which = weights[hit], column[hit], triangle[hit]
        height = np.sum(weights * triangles[which, :, 2], axis=1) / weights.sum(axis=1)
        below = np.clip(np.ceil(height - 0.5), 0, counts[2]).astype(np.int64)
        np.add.at(crossings, (column[:, 0], column[:, 1], below), np.sign(weights[:, 0]).astype(np.int64))
    return crossings


def _pairs(spans: Integers) -> Iterator[tuple[Integers, Integers]]:
    """Every (row, offset (3,)) with offset below spans (n, 3), in parts of bounded size."""
    sizes = spans.prod(axis=1)
    edges = np.cumsum(sizes)
    start = 0
    while start < len(sizes):
        before = edges[start - 1] if start else 0
        stop = max(int(np.searchsorted(edges, before + PAIRS, side="right")), start + 1)
        rows = np.repeat(np.arange(start, stop), sizes[start:stop])
        place = np.arange(len(rows)) - np.repeat(
            edges[start:stop] - sizes[start:stop] - before, sizes[start:stop]
        )
        extent = spans[rows]
        offset = np.stack(
            [
                place // (extent[:, 1] * extent[:, 2]),
                place // extent[:, 2] % extent[:, 1],
                place % extent[:, 2],
            ],
            axis=1,
        )
        yield rows, offset
        start = stop
