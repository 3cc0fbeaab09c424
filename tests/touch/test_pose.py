import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from touch_shapes import box, sphere

from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.first_touch import POLE_RAD, first_touch_poses
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.rendering.simulator import Simulator
from objectfolder.touch.sensor.gel import gel_constants, gel_surface
from objectfolder.touch.sensor.sensor import Sensor

COORDINATE = st.floats(-1, 1).filter(lambda value: value == 0 or abs(value) > 1e-150)
NORMALS = (
    st.tuples(COORDINATE, COORDINATE, COORDINATE)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 1e-3)
    .map(lambda v: v / np.linalg.norm(v))
)
ANGLES = st.floats(0, 2 * np.pi)


def first_touch(normal: np.ndarray, tilt: float = 0.0, azimuth: float = 0.0, roll: float = 0.0) -> np.ndarray:
    point, angles = np.array([[0.1, -0.2, 0.3]]), np.array([[tilt], [azimuth], [roll]])
    return first_touch_poses(point, normal[None], *angles, gel_constants(Sensor()))[0]


def contact_frame(normal: np.ndarray) -> np.ndarray:
    return first_touch(normal)[:3, :3]


def is_rotation(frame: np.ndarray) -> bool:
    return np.allclose(frame @ frame.T, np.eye(3), atol=1e-12) and np.linalg.det(frame) > 0


@given(NORMALS)
def test_a_contact_frame_is_a_rotation_that_looks_against_the_normal(normal: np.ndarray) -> None:
    frame = contact_frame(normal)
    assert is_rotation(frame)
    assert np.allclose(frame[:, 0], -normal, atol=1e-15)


@given(NORMALS, NORMALS, st.floats(0, 1e-3))
def test_the_roll_is_smooth_away_from_its_pole(normal: np.ndarray, towards: np.ndarray, step: float) -> None:
    if normal[2] < -0.8:
        normal = -normal
    moved = normal + step * towards
    moved /= np.linalg.norm(moved)
    change = np.linalg.norm(contact_frame(moved) - contact_frame(normal))
    # The frame turns at most 1 + 2 / (1 + z) <= 11 times as fast as the normal.
    assert change <= 12 * np.linalg.norm(moved - normal) + 1e-12


def test_the_roll_is_defined_at_and_round_its_pole(subtests: pytest.Subtests) -> None:
    for lateral in [0.0, 1e-300, 1e-160, 1e-16, 1e-9]:
        with subtests.test(lateral=lateral):
            frame = contact_frame(np.array([lateral, 0.0, -np.sqrt(1 - lateral**2)]))
            assert is_rotation(frame)
            assert np.allclose(frame, contact_frame(np.array([0.0, 0.0, -1.0])), atol=1e-8)


@pytest.mark.parametrize("turn", [0.0, 1.0, np.pi, 5.0])
def test_the_roll_is_smooth_within_its_pole(turn: float) -> None:
    lean = POLE_RAD * 0.99 * np.array([np.cos(turn), np.sin(turn)])
    frame = contact_frame(np.array([*lean, -np.sqrt(1 - lean @ lean)]))
    assert is_rotation(frame)
    assert np.abs(frame - contact_frame(np.array([0.0, 0.0, -1.0]))).max() < 1.01 * POLE_RAD


def test_the_pole_joins_the_rest_along_its_x_axis() -> None:
    inside, outside = (
        contact_frame(np.array([lean, 0.0, -np.sqrt(1 - lean**2)]))
        for lean in POLE_RAD * np.array([1 - 1e-9, 1 + 1e-9])
    )
    assert np.allclose(inside, outside, atol=1e-11)


def test_on_a_table_top_the_images_right_and_top_are_the_objects_x_and_y() -> None:
    frame = contact_frame(np.array([0.0, 0.0, 1.0]))
    assert np.allclose(-frame[:, 1], [1, 0, 0])
    assert np.allclose(frame[:, 2], [0, 1, 0])


@given(NORMALS, st.floats(0, np.radians(45)), ANGLES)
def test_a_tilt_leans_the_sensor_by_its_angle_towards_its_azimuth(
    normal: np.ndarray, tilt: float, azimuth: float
) -> None:
    frame = contact_frame(normal)
    leaned = first_touch(normal, tilt, azimuth)[:3, :3]
    assert is_rotation(leaned)
    back = -leaned[:, 0]
    right, top = -frame[:, 1], frame[:, 2]
    towards = np.cos(azimuth) * right + np.sin(azimuth) * top
    assert np.allclose(back, np.cos(tilt) * normal + np.sin(tilt) * towards, atol=1e-12)


@given(NORMALS, st.floats(0, np.radians(15)), ANGLES)
def test_a_tilted_gel_touches_a_flat_surface_at_the_point_and_nowhere_else(
    normal: np.ndarray, tilt: float, azimuth: float
) -> None:
    sensor, point = Sensor(), np.array([0.1, -0.2, 0.3])
    pose = first_touch(normal, tilt, azimuth)
    y, z = np.meshgrid(np.linspace(-0.01, 0.01, 41), np.linspace(0.0, 0.03, 41))
    gel = np.stack([gel_surface(sensor, y, z), y, z], axis=-1) @ pose[:3, :3].T + pose[:3, 3]
    height = (gel - point) @ normal
    assert height.min() > -1e-12
    assert np.linalg.norm(gel - point, axis=-1)[height < 1e-7].max(initial=0.0) < 5e-4


def mean_normal(surface: Surface, point: list[float]) -> np.ndarray:
    simulator = Simulator(FacePatches(surface), Sensor(), 1)
    return simulator.stand(np.array([point]), *np.zeros((3, 1)))[1][0]


def test_the_mean_normal_on_an_edge_of_a_box_halves_the_angle() -> None:
    cube = Surface(*box((0, 0, 0), (0.05, 0.05, 0.05)))
    assert np.allclose(mean_normal(cube, [0.05, 0.02, 0.05]), np.array([1, 0, 1]) / np.sqrt(2), atol=1e-9)
    assert np.allclose(mean_normal(cube, [0.05, 0.05, 0.05]), np.ones(3) / np.sqrt(3), atol=1e-9)
    assert np.allclose(mean_normal(cube, [0.05, 0.02, 0.03]), [1, 0, 0], atol=1e-12)


def test_the_mean_normal_near_an_edge_is_the_closed_form() -> None:
    # One millimetre from the edge: a disc of 2 mm cut by a chord at 1 mm, and over the edge a
    # segment of the disc of sqrt(3) mm.
    cube = Surface(*box((0, 0, 0), (0.05, 0.05, 0.05)))
    inner = 4 * (np.pi - np.arccos(0.5)) + np.sqrt(3)
    expected = np.array([3 * np.pi / 2, 0, inner])
    normal = mean_normal(cube, [0.049, 0.025, 0.05])
    assert np.allclose(normal, expected / np.linalg.norm(expected), atol=1e-9)


def test_the_other_side_of_a_thin_blade_does_not_count() -> None:
    blade = Surface(*box((0, 0, 0), (0.05, 0.02, 0.0004)))
    assert np.allclose(mean_normal(blade, [0.02, 0.01, 0.0004]), [0, 0, 1], atol=1e-12)
    assert np.allclose(mean_normal(blade, [0.02, 0.01, 0.0]), [0, 0, -1], atol=1e-12)


def test_a_face_counts_less_the_more_it_turns_towards_the_other_side() -> None:
    """Of a ridge whose faces are 120 degrees apart, by many points of the ball."""
    lean = np.radians(60)
    corners = [[0, -0.01, 0], [0, 0.01, 0]]
    corners += [[side * 0.006, y, -0.006 * np.tan(lean)] for side in (1, -1) for y in (-0.01, 0.01)]
    ridge = Surface(np.array(corners), np.array([[0, 2, 3], [0, 3, 1], [0, 1, 5], [0, 5, 4]]))
    point, normal = np.array([0.001 * np.cos(lean), 0.0, -0.001 * np.sin(lean)]), ridge.face_normals[0]
    points = ridge.sample(400_000, 0)
    near = np.linalg.norm(points.points - point, axis=1) < Sensor().contact_radius_m
    normals = ridge.face_normals[points.face[near]]
    share = np.clip(1 + normals @ normal / np.cos(np.pi / 4), 0, 1)
    expected = (share**2 * (3 - 2 * share)) @ normals
    mean = mean_normal(ridge, point.tolist())
    assert np.allclose(mean, expected / np.linalg.norm(expected), atol=5e-3)


def test_the_mean_normal_moves_smoothly_with_the_point() -> None:
    surface = Surface(*box((0, 0, 0), (0.05, 0.05, 0.001)))
    path = [[0.05 - s, 0.025, 0.001] for s in np.linspace(0.004, 0.0001, 40)]
    normals = np.array([mean_normal(surface, point) for point in path])
    turns = np.degrees(np.arccos(np.clip(np.sum(normals[1:] * normals[:-1], axis=1), -1, 1)))
    assert turns.max() < 5


def test_the_mean_normal_of_a_sphere_is_radial() -> None:
    surface = Surface(*sphere(0.02))
    samples = surface.sample(20, 0)
    normals = [mean_normal(surface, point) for point in samples.points]
    radial = samples.points / np.linalg.norm(samples.points, axis=1, keepdims=True)
    assert np.sum(normals * radial, axis=1).min() > np.cos(np.radians(0.5))
