"""Places of a boundary that points beside it follow: continuous, of sum one, one place where they touch."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from objectfolder.audio.modes.blended_places import blended_places
from objectfolder.surface.surface import Surface

EPSILON_M = 1e-4


def strip(x0: float, x1: float, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """A flat strip of 10 mm in two rows of squares, cut in triangles, z = 0."""
    grid = np.stack(np.meshgrid(np.linspace(x0, x1, cells + 1), [-0.005, 0.0, 0.005], indexing="ij"), axis=-1)
    vertices = np.concatenate([grid.reshape(-1, 2), np.zeros((grid.size // 2, 1))], axis=1)
    i, j = (each.ravel() for each in np.meshgrid(np.arange(cells), np.arange(2), indexing="ij"))
    a, b, c, d = 3 * i + j, 3 * (i + 1) + j, 3 * (i + 1) + j + 1, 3 * i + j + 1
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


@pytest.fixture(scope="module")
def slit() -> Surface:
    """Two strips in one plane, 2 mm apart, one of large triangles and one of small."""
    left, faces = strip(-0.02, -0.001, 2)
    right, more = strip(0.001, 0.02, 9)
    return Surface(np.concatenate([left, right]), np.concatenate([faces, more + len(left)]))


def read(surface: Surface, points: np.ndarray, epsilon_m: float = EPSILON_M) -> np.ndarray:
    """A field that is 0 on the left strip and 1 on the right, at points."""
    nearest = surface.closest_points(points)
    row, face, barycentric, share = blended_places(surface, points, nearest.distance, epsilon_m)
    assert np.array_equal(np.unique(row), np.arange(len(points)))
    assert (np.diff(row) >= 0).all()
    assert (share > 0).all()
    np.testing.assert_allclose(np.bincount(row, share), 1.0, rtol=1e-12)
    place = np.einsum("nc,ncd->nd", barycentric, surface.vertices[surface.faces[face]])
    return np.bincount(row, share * (place[:, 0] > 0))


def test_a_bridge_over_a_slit_goes_over_smoothly(slit: Surface) -> None:
    x = np.linspace(-0.004, 0.004, 2001)
    points = np.stack([x, np.full_like(x, 0.001), np.full_like(x, 0.0005)], axis=1)
    field = read(slit, points)
    # Where the nearest place alone is read, one of these steps is 1.
    assert np.abs(np.diff(field)).max() < 0.02
    assert field[0] == 0
    assert field[-1] == 1


def test_the_middle_follows_both_sides(slit: Surface) -> None:
    # The small triangles have more of the weight, by how many of them are near: neither side has all.
    assert 0.2 < read(slit, np.array([[0.0, 0.001, 0.0003]]))[0] < 0.8


def test_what_is_hardly_beyond_epsilon_has_nearly_one_place(slit: Surface) -> None:
    points = np.array([[-0.0071, 0.0011, 1.01 * EPSILON_M], [0.0057, 0.0023, -1.01 * EPSILON_M]])
    nearest = slit.closest_points(points)
    row, face, barycentric, share = blended_places(slit, points, nearest.distance, EPSILON_M)
    place = np.einsum("nc,ncd->nd", barycentric, slit.vertices[slit.faces[face]])
    mean = np.stack([np.bincount(row, share * place[:, axis]) for axis in range(3)], axis=1)
    assert np.linalg.norm(mean - nearest.points, axis=1).max() < 0.3 * EPSILON_M


@settings(deadline=None, max_examples=40)
@given(st.floats(-0.02, 0.02), st.floats(-0.005, 0.005), st.floats(2e-4, 3e-3))
def test_places_are_as_near_as_the_weight_says(x: float, y: float, z: float) -> None:
    left, faces = strip(-0.02, -0.001, 2)
    surface = Surface(left, faces)
    points = np.array([[x, y, z]])
    distance = surface.closest_points(points).distance
    _, face, barycentric, _ = blended_places(surface, points, distance, EPSILON_M)
    place = np.einsum("nc,ncd->nd", barycentric, surface.vertices[surface.faces[face]])
    farthest = np.linalg.norm(place - points, axis=1).max()
    assert farthest <= distance[0] + 4 * (distance[0] - EPSILON_M) + 1e-12


def test_no_points_no_places(slit: Surface) -> None:
    row, face, barycentric, share = blended_places(slit, np.zeros((0, 3)), np.zeros(0), EPSILON_M)
    assert len(row) == len(face) == len(barycentric) == len(share) == 0
