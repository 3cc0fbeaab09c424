"""Edges inside a bent wall follow its two sides."""

import numpy as np
from structured_solids import box

from objectfolder.making.elements.curving import bend_along
from objectfolder.making.elements.hierarchic import EDGES
from objectfolder.making.elements.space import Space
from objectfolder.making.solid.solid import boundary_of


def space_of(cells: tuple[int, int, int], size: tuple[float, float, float]) -> Space:
    solid = box(cells, size)
    return Space.on(solid.vertices, solid.tetrahedra, order=2)


def _bends(space: Space, curvature: float) -> tuple[np.ndarray, np.ndarray]:
    """Every edge bent as z = curvature x^2 / 2 bends it, and the functions of the boundary's edges."""
    faces, _, _ = boundary_of(space.tetrahedra)
    pairs = {tuple(sorted(pair)) for face in faces for pair in (face[:2], face[1:], face[[0, 2]])}
    vertices = space.geometry[: space.vertex_count]
    geometry = space.geometry.copy()
    boundary = set()
    # The function of an edge is 4 la lb up to its factor, which the middle of the edge tells.
    for element in range(len(space.tetrahedra)):
        for local in range(6):
            number = space.numbers[element, 4 + local]
            a, b = _ends(space, element, local)
            along = vertices[b, 0] - vertices[a, 0]
            middle = np.zeros((1, 4))
            middle[0, [list(space.tetrahedra[element]).index(v) for v in (a, b)]] = 0.5
            unit = np.zeros((len(geometry), 1))
            unit[number] = 1
            height = space.values(unit, np.array([element]), middle)[0, 0]
            geometry[number] = (0, 0, -curvature * along**2 / 8 / height)
            if (min(a, b), max(a, b)) in pairs:
                boundary.add(number)
    return geometry, np.array(sorted(boundary))


def _ends(space: Space, element: int, local: int) -> tuple[int, int]:
    a, b = space.tetrahedra[element, EDGES[local]]
    return int(a), int(b)


def test_a_wall_bent_to_a_parabola_is_bent_throughout() -> None:
    """The vertices stay where they are: what is left is a parabola on each edge, known inside too."""
    space = space_of((6, 4, 2), (6.0, 4.0, 0.3))
    bent, boundary = _bends(space, 0.1)
    inner = np.setdiff1d(np.unique(space.numbers[:, 4:10]), boundary)
    assert len(inner) > 100
    boundary_bends = np.zeros_like(bent)
    boundary_bends[: space.vertex_count] = bent[: space.vertex_count]
    boundary_bends[boundary] = bent[boundary]
    bends = bend_along(space, boundary_bends, boundary)
    np.testing.assert_array_equal(bends[boundary], bent[boundary])
    size = np.abs(bent[inner]).max()
    assert np.abs(bends[inner] - bent[inner]).max() < 0.25 * size
    assert np.sqrt(np.mean((bends[inner] - bent[inner]) ** 2)) < 0.05 * size


def test_a_straight_boundary_leaves_inner_edges_straight() -> None:
    space = space_of((2, 2, 2), (1.0, 1.0, 1.0))
    geometry, boundary = _bends(space, 0.0)
    np.testing.assert_array_equal(bend_along(space, geometry, boundary), geometry)
