import numpy as np
import pytest

from objectfolder.errors import QueryError
from objectfolder.vision.cameras import (
    focal_length_px,
    image_box,
    look_at,
    pixel_rays,
    project,
    sub_ray_offsets,
    uniform_on_sphere,
)


def test_the_paper_s_focal_length():
    assert focal_length_px(256, 39.6) == pytest.approx(355.56, abs=0.1)


def test_cameras_look_at_the_origin_from_anywhere_poles_included():
    positions = np.concatenate(
        [
            uniform_on_sphere(50, 2.5, np.random.default_rng(0)),
            [[0, 0, 2.5], [0, 0, -2.5], [1e-9, 0, 2.5], [2.5, 0, 0]],
        ]
    )
    poses = look_at(positions)
    rotations = poses[:, :3, :3]
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 2, 1), np.tile(np.eye(3), (54, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    np.testing.assert_allclose(-rotations[:, :, 2] * 2.5, -positions, atol=1e-12)


def test_up_in_the_image_is_up_in_the_world():
    pose = look_at(np.array([[2.5, 0, 0]]))[0]
    above = project(np.array([[0, 0, 0.1]]), pose, 100, 40.0)
    assert above[0, 0] == pytest.approx(50)
    assert above[0, 1] < 50


def test_points_lie_in_their_box_and_those_beside_the_camera_anywhere():
    pose, size = look_at(np.array([[0.0, -2.0, 0.0]]))[0], (40, 60)
    corners = np.array([[-0.5, 0.0, -0.25], [0.5, 0.0, 0.25]])
    focal = focal_length_px(size, 60.0)  # 52: the points are 26 and 13 pixels wide
    assert image_box(corners, pose, size, 60.0) == (13, 17, 14, 26)
    assert focal == pytest.approx(51.96, abs=0.01)
    assert image_box(corners, pose, size, 60.0, margin_px=3) == (10, 14, 20, 32)
    assert image_box(corners + np.array([0.0, 0.0, 0.6]), pose, size, 60.0, margin_px=3) == (0, 14, 14, 32)
    assert image_box(corners + np.array([0.0, 0.0, 9.0]), pose, size, 60.0)[2:] == (0, 26)
    assert image_box(corners - np.array([0.0, 2.0, 0.0]), pose, size, 60.0) == (0, 0, *size)


def test_a_camera_at_its_target_is_refused():
    with pytest.raises(QueryError, match="camera"):
        look_at(np.zeros((1, 3)))


@pytest.mark.parametrize("size", [(40, 40), (30, 50), (50, 30)])
def test_rays_pass_through_the_points_that_project_to_them(size):
    pose = look_at(np.array([[1.0, -2.0, 0.7]]))[0]
    pixels = np.arange(size[0] * size[1])
    origins, directions = pixel_rays(pose, pixels, np.array([[0.25, 0.75]]), size, 39.6)
    projections = project(origins + 3 * directions, pose, size, 39.6)
    row, column = np.divmod(pixels, size[1])
    np.testing.assert_allclose(projections, np.stack([column + 0.25, row + 0.75], axis=1), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)


def test_points_are_uniform_on_the_sphere_and_lights_clear_of_the_unit_cube():
    points = uniform_on_sphere(20000, 1.0, np.random.default_rng(3))
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(points.T @ points / len(points), np.eye(3) / 3, atol=0.02)
    outside = np.linalg.norm(np.maximum(np.abs(points) - 0.5, 0), axis=1)
    assert outside.min() > 0.133


@pytest.mark.parametrize("count", [1, 4, 16, 64])
def test_sub_rays_measure_the_area_beside_any_edge(count):
    offsets = sub_ray_offsets(count)
    assert offsets.shape == (count, 2)
    for angle in np.linspace(0, np.pi, 7):
        normal = np.array([np.cos(angle), np.sin(angle)])
        dense = np.stack(np.meshgrid(*[(np.arange(200) + 0.5) / 200] * 2), axis=-1).reshape(-1, 2)
        for level in np.linspace(-0.4, 0.4, 9):
            area = np.mean((dense - 0.5) @ normal < level)
            assert abs(np.mean((offsets - 0.5) @ normal < level) - area) < 1.5 / count**0.75


@pytest.mark.parametrize(("call", "word"), [
    (lambda: focal_length_px(0, 39.6), "resolution"),
    (lambda: focal_length_px(64, 180.0), "field_of_view"),
])  # fmt: skip
def test_impossible_images_are_refused(call, word):
    with pytest.raises(QueryError, match=word):
        call()


def test_rays_are_the_same_to_the_bit_in_any_company():
    pose = look_at(np.array([[1.0, -2.0, 0.7]]))[0]
    offsets = sub_ray_offsets(3)
    _, every = pixel_rays(pose, np.arange(600), offsets, (20, 30), 39.6)
    for count in (1, 2, 7, 64):
        _, some = pixel_rays(pose, np.arange(100, 100 + count), offsets, (20, 30), 39.6)
        np.testing.assert_array_equal(some, every[300 : 300 + 3 * count])
