"""The boundary of a solid drawn onto the surface it stands for, as far as its elements bear."""

import numpy as np
from numpy.typing import NDArray

from objectfolder.solid.element_shape import shape
from objectfolder.solid.facing_places import facing_places
from objectfolder.solid.solid import boundary_of
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def snap(
    vertices: Floats,
    tetrahedra: Integers,
    target: Surface,
    thickness: Floats,
    *,
    reach: float,
    least_shape: float = 0.2,
) -> Floats:
    """Vertices (v, 3) with those of the boundary on the surface, on the side of the wall they are on.

    A vertex stays where it was when an element at it would come to have a shape below `least_shape` and below
    its own before, or when the surface is farther along its normal than half the `thickness` (v,) plus
    `reach`.
    """
    faces, _, _ = boundary_of(tetrahedra)
    corner = vertices[faces]
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normals = np.zeros_like(vertices)
    for column in faces.T:
        np.add.at(normals, column, area)
    length = np.linalg.norm(normals, axis=1)
    outer = np.flatnonzero(length > 0)
    places, _ = facing_places(
        target, vertices[outer], normals[outer] / length[outer, None], thickness[outer] / 2 + reach
    )
    moved = vertices.copy()
    moved[outer] = places
    local = thickness[tetrahedra].min(axis=1)
    before, _ = shape(vertices[tetrahedra], local)
    floor = np.minimum(least_shape, before)
    while True:
        after, _ = shape(moved[tetrahedra], local)
        back = np.unique(tetrahedra[after < floor])
        back = back[(moved[back] != vertices[back]).any(axis=1)]
        if len(back) == 0:
            return moved
        moved[back] = vertices[back]
