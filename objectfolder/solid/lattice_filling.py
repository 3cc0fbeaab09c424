"""A surface filled without a mesher: a lattice of tetrahedra cut where the signed distance vanishes.

For surfaces so broken that fTetWild does not answer in time. Its time depends on the number of nodes alone;
walls thinner than two cells come out with holes or not at all, which the checks of `tetrahedra.fill` see.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from objectfolder.solid.element_shape import LOCAL_EDGES
from objectfolder.surface.signed_distance import signed_distance
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import WindingNumber

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
NEAR = 0.25  # of a cell: nodes this near the surface are moved onto it


def fill_with_lattice(surface: Surface, nodes: int) -> tuple[Floats, Integers]:
    """Vertices (v, 3) and tetrahedra (t, 4) of the inside of a surface, from about `nodes` lattice nodes."""
    field = signed_distance(surface, nodes)
    depth = np.where(np.abs(field.depth) < NEAR * field.cell, 0.0, field.depth)
    counts = np.array(depth.shape)
    first = np.stack(np.meshgrid(*[np.arange(n - 1) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3)
    corners = np.stack(
        [
            depth[first[:, 0] + i, first[:, 1] + j, first[:, 2] + k]
            for i, j, k in itertools.product((0, 1), repeat=3)
        ]
    )
    first = first[(corners > 0).any(axis=0)]
    strides = np.array([counts[1] * counts[2], counts[2], 1])
    tetrahedra = np.concatenate(
        [
            np.stack([first @ strides + offset for offset in _path(order, strides)], axis=1)
            for order in itertools.permutations(range(3))
        ]
    )
    used, tetrahedra = np.unique(tetrahedra, return_inverse=True)
    tetrahedra = tetrahedra.reshape(-1, 4)
    index = np.stack(np.unravel_index(used, tuple(counts)), axis=1)
    vertices = field.origin + field.cell * index
    level = depth.ravel()[used]
    vertices[level == 0] = surface.sampled_distance.nearest(vertices[level == 0])[0]
    vertices, level, tetrahedra = _cut(vertices, level, tetrahedra)
    around = level[tetrahedra]
    on_surface = np.flatnonzero((around == 0).all(axis=1))
    middle = vertices[tetrahedra[on_surface]].mean(axis=1)
    kept = (around >= 0).all(axis=1)
    kept[on_surface] = WindingNumber(surface)(middle) > 0.5
    used, packed = np.unique(tetrahedra[kept], return_inverse=True)
    return vertices[used], packed.reshape(-1, 4)


def _path(order: tuple[int, ...], strides: Integers) -> list[int]:
    """Offsets of the nodes on the way along three axes from one corner of a cell to the opposite one."""
    return [0, *np.cumsum(strides[list(order)]).tolist()]


def _cut(vertices: Floats, depth: Floats, tetrahedra: Integers) -> tuple[Floats, Floats, Integers]:
    """Split elements at each edge that crosses depth 0, lowest edge first: vertices, depths, elements.

    Elements that share a face split its edges in the same order, at the same points, so that the parts fit.
    """
    count = len(vertices)
    names, crosses = _edges(tetrahedra, depth, count)
    cuts = np.unique(names[crosses])
    one, other = cuts // count, cuts % count
    share = (depth[one] / (depth[one] - depth[other]))[:, None]
    vertices = np.concatenate([vertices, vertices[one] + share * (vertices[other] - vertices[one])])
    depth = np.concatenate([depth, np.zeros(len(cuts))])
    while True:
        names, crosses = _edges(tetrahedra, depth, count)
        cut = crosses.any(axis=1)
        if not cut.any():
            return vertices, depth, tetrahedra
        rank = np.where(crosses, names, np.iinfo(np.int64).max)[cut]
        edge = rank.argmin(axis=1)
        middle = count + np.searchsorted(cuts, rank.min(axis=1))
        parts = []
        for end in (0, 1):
            part = tetrahedra[cut].copy()
            part[np.arange(len(part)), LOCAL_EDGES[edge, end]] = middle
            parts.append(part)
        tetrahedra = np.concatenate([tetrahedra[~cut], *parts])


def _edges(tetrahedra: Integers, depth: Floats, count: int) -> tuple[Integers, NDArray[np.bool_]]:
    """A number for each edge (t, 6) of the elements, and whether it crosses depth 0.

    Only edges between the first `count` vertices cross: the others end where the depth is 0.
    """
    pair = tetrahedra[:, LOCAL_EDGES]
    crosses = depth[pair[..., 0]] * depth[pair[..., 1]] < 0
    return pair.min(axis=2) * count + pair.max(axis=2), crosses
