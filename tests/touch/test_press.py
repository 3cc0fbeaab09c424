from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from touch_shapes import box, bumpy, psnr_db, sphere

from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.presses.press import press, render_poses
from objectfolder.touch.presses.touches import Press, Touches
from objectfolder.touch.sensor.camera import no_contact_image, ray_grid
from objectfolder.touch.sensor.gel import gel_sag, gel_surface
from objectfolder.touch.sensor.sensor import Sensor
from tests.drawn_examples import few_examples

SENSOR = Sensor()
BUMPY = bumpy()
BUMPY_PATCHES = FacePatches(BUMPY)


def pixel_rays() -> tuple[np.ndarray, np.ndarray]:
    grid = ray_grid(SENSOR, 1)
    v, u = np.meshgrid(grid.v, grid.u, indexing="ij")
    return u, v


@pytest.mark.parametrize("depth", [0.0003, 0.0005, 0.00075])
def test_a_pressed_plane_has_the_closed_forms_depth_map_area_and_mask(depth: float) -> None:
    plane = Surface(*box((-0.05, -0.05, -0.02), (0.05, 0.05, 0.0)))
    touch = press(plane, SENSOR, np.array([[0.003, -0.004, 0.0]]), Press(depth_m=depth, samples=1))
    u, v = pixel_rays()
    x = 0.022 - depth
    expected = np.maximum(gel_surface(SENSOR, u * x, 0.015 + v * x) - x, 0.0)
    assert np.abs(touch.depth_m[0] - expected).max() < 2e-7
    assert (touch.mask[0] == (expected > 0)).mean() > 0.9999
    assert touch.penetration_m[0] == depth
    assert touch.first_contact_offset_m[0] < 1e-12
    assert touch.reachable[0]
    # The gel's sag equals the depth at the rim of the contact.
    cap = SENSOR.gel_radius_m - depth / SENSOR.gel_stretch
    area = np.pi * (SENSOR.gel_radius_m**2 - cap**2)
    assert touch.contact_area_m2[0] == pytest.approx(area, rel=0.005)


@pytest.mark.parametrize(("radius", "depth"), [(0.006, 0.001), (0.012, 0.001), (0.05, 0.0005)])
def test_a_pressed_sphere_has_the_closed_forms_depth_map_and_area(radius: float, depth: float) -> None:
    ball = Surface(*sphere(radius, 6))
    direction = np.array([2.0, -1.0, 2.0]) / 3
    touch = press(ball, SENSOR, radius * direction[None], Press(depth_m=depth, samples=1))
    u, v = pixel_rays()
    # Ray from the camera to a ball whose nearest point is `depth` inside the apex.
    centre = np.array([0.022 - depth + radius, 0.0, 0.0])
    a = 1 + u**2 + v**2
    root = centre[0] ** 2 - a * (centre[0] ** 2 - radius**2)
    x = np.where(root > 0, (centre[0] - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    expected = np.where(
        root > 0, gel_surface(SENSOR, u * np.minimum(x, 1), 0.015 + v * np.minimum(x, 1)) - x, 0
    )
    expected = np.maximum(expected, 0)
    inside = expected > 2e-5
    assert inside.sum() > 500
    assert np.abs(touch.depth_m[0] - expected)[inside].max() < 2e-5
    # Rim: the ball's sagitta and the gel's add up to the depth.
    low, high = 0.0, radius
    for _ in range(60):
        middle = (low + high) / 2
        together = radius - np.sqrt(radius**2 - middle**2) + gel_sag(SENSOR, np.array(middle**2))
        low, high = (middle, high) if together < depth else (low, middle)
    cap_height = radius - np.sqrt(radius**2 - low**2)
    assert touch.contact_area_m2[0] == pytest.approx(2 * np.pi * radius * cap_height, rel=0.01)
    assert touch.reachable[0]


@given(st.floats(0, 0.002), st.floats(0, 15), st.floats(0, 360), st.integers(0, 10_000))
def test_no_image_shows_the_object_deeper_than_its_label(
    depth: float, tilt: float, azimuth: float, seed: int
) -> None:
    points = BUMPY.sample(2, seed).points
    touch = press(
        BUMPY_PATCHES, SENSOR, points, Press(depth_m=depth, tilt_deg=tilt, azimuth_deg=azimuth, samples=1)
    )
    assert (touch.depth_m.max(axis=(1, 2)) <= touch.penetration_m + 1e-12).all()
    assert (touch.penetration_m == depth).all()
    assert (touch.depth_m >= 0).all()
    assert (touch.depth_m[touch.mask] >= 0).all()
    assert (touch.depth_m[~touch.mask] == 0).all()
    rotation = touch.sensor_to_object[:, :3, :3]
    assert np.allclose(rotation @ rotation.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert (np.linalg.det(rotation) > 0).all()
    assert (touch.sensor_to_object[:, 3] == [0, 0, 0, 1]).all()


def test_the_depth_map_shows_the_whole_penetration_of_a_small_ball() -> None:
    ball = Surface(*sphere(0.004))
    touch = press(ball, SENSOR, ball.vertices[[100, 200, 300]], Press(depth_m=0.0015, samples=2))
    assert np.allclose(touch.depth_m.max(axis=(1, 2)), 0.0015, atol=1e-5)


def test_pixels_without_contact_show_the_untouched_gel() -> None:
    touch = press(BUMPY_PATCHES, SENSOR, BUMPY.sample(3, 1).points)
    background = no_contact_image(SENSOR)
    for image, depth in zip(touch.rgb, touch.depth_m, strict=True):
        beside = depth == 0
        for axis in (0, 1):
            beside = beside & np.roll(beside, 1, axis) & np.roll(beside, -1, axis)
        assert 1000 < beside.sum() < 18000
        assert (image[beside] == background[beside]).all()
        assert psnr_db(image, background) < 40


def test_a_batch_answers_as_single_presses_do_bit_for_bit() -> None:
    points = BUMPY.sample(7, 3).points
    depth = np.linspace(0.0002, 0.002, 7)
    tilt, azimuth = np.linspace(0, 15, 7), np.linspace(0, 300, 7)
    batch = press(BUMPY_PATCHES, SENSOR, points, Press(depth_m=depth, tilt_deg=tilt, azimuth_deg=azimuth))
    for index in range(7):
        single = press(
            BUMPY,
            SENSOR,
            points[index : index + 1],
            Press(depth_m=depth[index], tilt_deg=tilt[index], azimuth_deg=azimuth[index]),
        )
        assert_equal_touches(single, batch, slice(index, index + 1))


def assert_equal_touches(part: Touches, whole: Touches, rows: slice) -> None:
    for name, values in vars(part).items():
        same = np.array_equal(values, getattr(whole, name)[rows], equal_nan=name == "force_n")
        assert same, name


def test_the_order_of_faces_and_of_their_corners_does_not_matter() -> None:
    random = np.random.default_rng(0)
    points = BUMPY.sample(4, 5).points
    faces = BUMPY.faces[random.permutation(len(BUMPY.faces))]
    rotation = (random.integers(0, 3, len(faces))[:, None] + np.arange(3)) % 3
    shuffled = Surface(BUMPY.vertices, np.take_along_axis(faces, rotation, axis=1))
    touches = press(BUMPY_PATCHES, SENSOR, points)
    shuffled_touches = press(shuffled, SENSOR, points)
    assert np.abs(touches.rgb.astype(int) - shuffled_touches.rgb).max() <= 1
    assert np.abs(touches.depth_m - shuffled_touches.depth_m).max() < 3e-7
    assert np.allclose(touches.first_contact_offset_m, shuffled_touches.first_contact_offset_m, atol=1e-10)


@given(st.integers(0, 1000), st.floats(-1, 1), st.floats(-np.pi, np.pi))
@few_examples(10)
def test_moving_object_and_sensor_together_leaves_the_image(seed: int, shift: float, angle: float) -> None:
    touch = press(BUMPY_PATCHES, SENSOR, BUMPY.sample(1, seed).points, Press(samples=1))
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    motion = np.eye(4)
    motion[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    motion[:3, 3] = shift * np.array([1.0, -0.5, 0.25])
    moved = Surface(BUMPY.vertices @ motion[:3, :3].T + motion[:3, 3], BUMPY.faces)
    image = render_poses(moved, SENSOR, motion @ touch.sensor_to_object, samples=1)[0]
    assert psnr_db(touch.rgb[0], image.rgb) > 60
    assert np.abs(image.depth - touch.depth_m[0])[image.mask & touch.mask[0]].max() < 1e-6


def test_a_translated_object_feels_the_same_where_it_is_pressed() -> None:
    shift = np.array([0.4, -0.3, 0.7])
    points = BUMPY.sample(3, 11).points
    home = press(BUMPY_PATCHES, SENSOR, points)
    away = press(Surface(BUMPY.vertices + shift, BUMPY.faces), SENSOR, points + shift)
    assert np.abs(home.rgb.astype(int) - away.rgb).max() <= 1
    assert np.allclose(home.sensor_to_object[:, :3, 3] + shift, away.sensor_to_object[:, :3, 3], atol=1e-9)


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ({"depth_m": -0.001}, "depth_m: -0.001 m is out of range"),
        ({"depth_m": 0.02}, "Ask for 0 to 0.005"),
        ({"depth_m": np.nan}, "not finite"),
        ({"tilt_deg": 60.0}, "tilt_deg: 60.0 degrees is out of range"),
        ({"azimuth_deg": np.zeros(3)}, "azimuth_deg: shape .* Give a number or"),
    ],
)
def test_impossible_queries_are_refused_by_name(query: dict[str, Any], message: str) -> None:
    with pytest.raises(QueryError, match=message):
        press(BUMPY_PATCHES, SENSOR, BUMPY.vertices[:2], Press(**query))


@pytest.mark.parametrize("points", [np.zeros((1, 1, 3)), np.zeros((2, 2)), np.full((1, 3), np.nan)])
def test_points_of_the_wrong_shape_are_refused(points: np.ndarray) -> None:
    with pytest.raises(QueryError, match="points"):
        press(BUMPY_PATCHES, SENSOR, points)


def test_no_points_make_no_touches() -> None:
    touch = press(BUMPY_PATCHES, SENSOR, np.zeros((0, 3)))
    assert touch.rgb.shape == (0, 160, 120, 3)
    assert len(touch) == 0


def test_a_gel_pressed_to_its_limit_is_saturated() -> None:
    touch = press(
        BUMPY_PATCHES, SENSOR, BUMPY.sample(2, 1).points, Press(depth_m=np.array([0.0049, 0.005]), samples=1)
    )
    assert touch.saturated.tolist() == [False, True]


def test_the_rigid_gel_bears_no_force_and_refuses_to_be_asked_for_one() -> None:
    point = BUMPY.sample(1, 1).points
    assert np.isnan(press(BUMPY_PATCHES, SENSOR, point, Press(samples=1)).force_n).all()
    with pytest.raises(QueryError, match="force_n: a rigid contact bears no force"):
        press(BUMPY_PATCHES, SENSOR, point, Press(force_n=1.0, contact="rigid"))
    with pytest.raises(QueryError, match="Use 'rigid' or 'elastic'"):
        press(BUMPY_PATCHES, SENSOR, point, Press(contact="sticky"))


def test_any_number_of_samples_a_side_up_to_four_answers_alike_and_more_converge() -> None:
    points = BUMPY.sample(3, 2).points
    images = [press(BUMPY_PATCHES, SENSOR, points, Press(samples=samples)).rgb for samples in (1, 2, 3, 4)]
    coarse, fine, finer = (psnr_db(images[-1], image) for image in images[:-1])
    assert 40 < coarse < fine - 3
    assert finer > 40
