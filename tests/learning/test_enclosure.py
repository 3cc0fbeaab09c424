"""Enclosed points against closed forms, and against rays through a tree of boxes."""

import numpy as np
import pytest
import trimesh

from learning.enclosure import Columns


def random_points(count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.6, 0.6, (count, 3))


def test_a_box_by_its_closed_form():
    box = trimesh.creation.box((0.5, 0.7, 0.3))
    points = random_points(20_000)
    expected = np.all(np.abs(points) < (0.25, 0.35, 0.15), axis=1)
    np.testing.assert_array_equal(Columns(points).inside(box), expected)


def test_points_in_line_with_edges_and_vertices_cross_one_face():
    box = trimesh.creation.box((1, 1, 1))
    line = np.linspace(-0.45, 0.45, 19)  # the diagonals of the faces run through these
    points = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    assert Columns(points).inside(box).all()
    assert not Columns(points + np.array([1.0, 0, 0])).inside(box).any()
    assert not Columns(points - np.array([1.0, 0, 0])).inside(box).any()


def test_a_hollow_of_nested_balls_is_outside():
    outer, inner = trimesh.creation.icosphere(3, 0.5), trimesh.creation.icosphere(3, 0.3)
    inner.invert()
    points = random_points(20_000)
    lengths = np.linalg.norm(points, axis=1)
    enclosed = Columns(points).inside(trimesh.util.concatenate([outer, inner]))
    assert enclosed[(lengths > 0.31) & (lengths < 0.49)].all()
    assert not enclosed[(lengths < 0.29) | (lengths > 0.51)].any()


@pytest.mark.parametrize("count", [1, 3000])
def test_as_rays_through_a_tree_find_them(count: int):
    torus = trimesh.creation.torus(0.35, 0.12)
    points = random_points(count)
    np.testing.assert_array_equal(Columns(points).inside(torus), torus.contains(points))


def test_columns_are_asked_again_and_points_beside_the_surface_are_outside():
    columns = Columns(random_points(2000) + np.array([0, 5, 0]))
    assert not columns.inside(trimesh.creation.icosphere(2, 0.5)).any()
    assert columns.inside(trimesh.creation.box((12, 12, 12))).all()


def test_no_points():
    assert Columns(np.empty((0, 3))).inside(trimesh.creation.box()).shape == (0,)
