"""Vertices that say nothing of a surface's shape."""

import numpy as np
import pytest
import trimesh

from objectfolder.making.solid.redundant_vertices import SURFACE_TOLERANCE, without_redundant_vertices
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import enclosed_volume


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


def cut_in_four(surface: Surface, times: int = 1) -> Surface:
    for _ in range(times):
        surface = Surface(*trimesh.remesh.subdivide(surface.vertices, surface.faces))
    return surface


@pytest.mark.parametrize("times", [1, 2, 3])
def test_a_box_cut_in_small_triangles_has_its_eight_corners_again(times: int) -> None:
    box = surface_of(trimesh.creation.box((3.0, 2.0, 1.0)))
    surface = without_redundant_vertices(cut_in_four(box, times))
    assert sorted(map(tuple, surface.vertices)) == sorted(map(tuple, box.vertices))
    assert enclosed_volume(surface)[0] == pytest.approx(6.0)


def test_a_round_surface_cut_in_four_has_its_own_triangles_again() -> None:
    ball = surface_of(trimesh.creation.icosphere(3, 0.05))
    surface = without_redundant_vertices(cut_in_four(ball))
    assert len(surface.faces) == len(ball.faces)
    assert {tuple(v) for v in surface.vertices} == {tuple(v) for v in ball.vertices}


def test_a_round_surface_is_left_as_it_is() -> None:
    ball = surface_of(trimesh.creation.icosphere(4, 0.05))
    assert without_redundant_vertices(ball) is ball


@pytest.mark.parametrize(("off", "corners"), [(0.5 * SURFACE_TOLERANCE, 8), (3 * SURFACE_TOLERANCE, 9)])
def test_a_vertex_goes_only_where_the_surface_moves_by_less_than_the_tolerance(
    off: float, corners: int
) -> None:
    fine = cut_in_four(surface_of(trimesh.creation.box((1.0, 1.0, 1.0))))
    middle = np.linalg.norm(fine.vertices - [0.5, 0.5, 0.0], axis=1).argmin()  # of an edge
    fine.vertices[middle] += off * np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    moved = without_redundant_vertices(Surface(fine.vertices, fine.faces))
    assert (len(moved.vertices) == 8) == (corners == 8)


def test_a_surface_that_is_not_closed_is_left_as_it_is() -> None:
    box = cut_in_four(surface_of(trimesh.creation.box((1.0, 1.0, 1.0))))
    sheet = Surface(box.vertices, box.faces[:-1])
    assert without_redundant_vertices(sheet) is sheet
