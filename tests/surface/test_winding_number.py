"""Inside and outside, and volume, of surfaces with and without holes."""

import numpy as np
import pytest
from small_meshes import CUBE_FACES, CUBE_VERTICES, sphere

from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import WindingNumber, enclosed_volume, is_closed, solid_angles


def exactly(surface: Surface, points: np.ndarray) -> np.ndarray:
    """The sum over all faces of their solid angles."""
    triangles = surface.vertices[surface.faces]
    return np.array(
        [solid_angles(triangles, np.tile(point, (len(triangles), 1))).sum() / (4 * np.pi) for point in points]
    )


def test_solid_angle_of_an_octant_and_of_a_cubes_face():
    octant = np.eye(3)[None]
    assert solid_angles(octant, np.zeros((1, 3)))[0] == pytest.approx(np.pi / 2)
    assert solid_angles(octant[:, ::-1], np.zeros((1, 3)))[0] == pytest.approx(-np.pi / 2)
    angles = solid_angles(CUBE_VERTICES[CUBE_FACES], np.zeros((12, 3)))
    np.testing.assert_allclose(angles, 4 * np.pi / 12)


def test_dipoles_stand_for_far_faces():
    vertices, faces = sphere(1.0, 3)
    opened = Surface(vertices, faces[: len(faces) * 3 // 4])
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (200, 3))
    np.testing.assert_allclose(WindingNumber(opened)(points), exactly(opened, points), atol=0.04)


def test_inside_of_a_hollow_ball_is_its_wall():
    vertices, faces = sphere(1.0, 3)
    both = Surface(
        np.concatenate([vertices, 0.5 * vertices]), np.concatenate([faces, faces[:, ::-1] + len(vertices)])
    )
    radii = np.array([0.1, 0.4, 0.6, 0.9, 1.1, 3.0])
    inside = WindingNumber(both)(radii[:, None] * np.array([[0.48, 0.6, 0.64]])) > 0.5
    np.testing.assert_array_equal(inside, [False, False, True, True, False, False])


def test_volume_of_closed_and_open_boxes():
    cube = Surface(CUBE_VERTICES * [2, 1, 0.5] + 3, CUBE_FACES)
    assert is_closed(cube)
    assert enclosed_volume(cube) == (pytest.approx(1.0), 0.0)
    corners = np.concatenate([CUBE_VERTICES, CUBE_VERTICES + 0.5])
    crossing = Surface(corners, np.concatenate([CUBE_FACES, CUBE_FACES + len(CUBE_VERTICES)]))
    volume, error = enclosed_volume(crossing)
    assert abs(volume - 1.875) < 4 * error < 0.06
    vertices, faces = sphere(1.0, 2)
    holed = Surface(vertices, faces[12:])
    assert not is_closed(holed)
    volume, error = enclosed_volume(holed)
    assert 0 < error < 0.03
    assert abs(volume - enclosed_volume(Surface(vertices, faces))[0]) < 4 * error


def test_a_sheet_encloses_nothing():
    sheet = Surface(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), np.array([[0, 1, 2]]))
    assert enclosed_volume(sheet)[0] < 1e-4
