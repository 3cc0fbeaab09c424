"""Where the sensor can be pressed: its way there, and its roll."""

import numpy as np
import pytest
from touch_shapes import box, joined, mug, sphere

from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.press import press, reach
from objectfolder.touch.presses.touches import Press, Reach
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.touchnet import TouchNet

SENSOR = Sensor()


def test_no_point_inside_a_sealed_ball_is_reachable() -> None:
    # A metre across: the sensor would stand in it, but cannot come in.
    vertices, faces = sphere(0.5, 4)
    ball = Surface(vertices, faces[:, ::-1])
    points = vertices[[100, 700, 900]]
    assert np.sum(press(ball, SENSOR, points).normals * points, axis=1).max() < 0
    assert not press(ball, SENSOR, points).reachable.any()
    assert not reach(ball, SENSOR, points, Press(), 24).at_some_roll.any()
    assert press(Surface(vertices, faces), SENSOR, points).reachable.all()
    elastic = Press(depth_m=0.0005, contact="elastic")
    assert not press(ball, SENSOR, points, elastic).reachable.any()
    # Without its lid it can.
    open_below = vertices[faces][:, :, 2].max(axis=1) <= 0.3
    bowl = Surface(vertices, faces[open_below][:, ::-1])
    assert press(bowl, SENSOR, np.array([[0.0, 0.0, -0.5]])).reachable.all()


@pytest.mark.parametrize(("gap", "reachable"), [(0.0300, False), (0.0325, True)])
def test_the_way_there_must_be_as_wide_as_the_housing(gap: float, reachable: bool) -> None:
    # A slit 10 cm over the floor: the housing is 32 mm high, and 27 mm wide.
    floor = box((-0.2, -0.2, -0.01), (0.2, 0.2, 0.0))
    lips = [box((-0.2, y, 0.10), (0.2, y + 0.1, 0.11)) for y in (gap / 2, -gap / 2 - 0.1)]
    slit = Surface(*joined(floor, *lips))
    # At a roll of 0 the height of the housing, -1 to 31 mm about a gel at 15, lies across the slit.
    touch = press(slit, SENSOR, np.zeros((1, 3)))
    assert touch.reachable.tolist() == [reachable]
    turned = press(slit, SENSOR, np.zeros((1, 3)), Press(roll_deg=90.0))
    assert turned.reachable.all()
    reachability = reach(slit, SENSOR, np.zeros((1, 3)), Press(), 24)
    assert reachability.at_some_roll.all()
    assert reachability.best_roll_deg.tolist() == [0.0 if reachable else 90.0]


def test_a_cup_is_touched_at_its_bottom_by_some_rolls_where_one_does_not_fit() -> None:
    # Within 24 mm, half of the housing is 13.5 x 16: it may be 4.4 mm off the middle along its shorter side,
    # 3.8 along its longer one.
    cup = Surface(*mug(radius=0.028, height=0.04))
    angle = np.deg2rad(np.arange(0, 360, 15))
    ring = np.stack([0.0041 * np.cos(angle), 0.0041 * np.sin(angle), np.full(24, 0.004)], axis=1)
    touches, somewhere = press(cup, SENSOR, ring, Press(samples=1)), reach(cup, SENSOR, ring, Press(), 36)
    assert touches.reachable.tolist() == somewhere.reachable[:, 0].tolist()
    assert 0 < touches.reachable.sum() < somewhere.at_some_roll.sum()
    rows = np.flatnonzero(somewhere.at_some_roll)
    again = press(cup, SENSOR, ring[rows], Press(roll_deg=somewhere.best_roll_deg[rows], samples=1))
    assert again.reachable.all()


def test_the_best_roll_has_most_room_and_is_the_nearest_of_equal_ones() -> None:
    rolls = np.arange(8) * 45.0
    fits = np.array(
        [[1, 1, 1, 1, 1, 1, 1, 1], [0] * 8, [1, 0, 1, 1, 1, 0, 0, 0], [0, 0, 1, 0, 0, 0, 1, 0]], bool
    )
    best = Reach(np.tile(rolls, (4, 1)), fits).best_roll_deg
    assert best[[0, 2, 3]].tolist() == [0.0, 135.0, 90.0]
    assert np.isnan(best[1])


@pytest.mark.parametrize("tilt", [0.0, 20.0])
def test_a_roll_turns_the_sensor_about_its_axis_and_the_image_with_it(tilt: float) -> None:
    ridge = Surface(
        *joined(
            box((-0.03, -0.03, -0.01), (0.03, 0.03, 0.0)), box((-0.03, -0.001, 0.0), (0.03, 0.001, 0.001))
        )
    )
    point = np.array([[0.0, 0.0, 0.001]])
    still, turned = (
        press(ridge, SENSOR, point, Press(tilt_deg=tilt, azimuth_deg=30.0, roll_deg=roll))
        for roll in (0.0, 90.0)
    )
    frame, rolled_frame = still.sensor_to_object[0, :3, :3], turned.sensor_to_object[0, :3, :3]
    assert np.allclose(frame[:, 0], rolled_frame[:, 0], atol=1e-12)
    # The image's right, -y, is where the top, z, was.
    assert np.allclose(-rolled_frame[:, 1], frame[:, 2], atol=1e-12)
    if not tilt:
        rows, columns = (np.ptp(np.argwhere(touch.mask[0]), axis=0) for touch in (still, turned))
        assert rows[1] > 2 * rows[0]
        assert columns[0] > 2 * columns[1]


def test_a_whole_turn_changes_nothing() -> None:
    vertices, faces = sphere(0.02, 3)
    touches, turned_touches = (
        press(Surface(vertices, faces), SENSOR, vertices[:3], Press(roll_deg=r)) for r in (0.0, 360.0)
    )
    assert np.allclose(touches.sensor_to_object, turned_touches.sensor_to_object, atol=1e-12)


def test_noise_by_query_is_that_of_single_queries() -> None:
    vertices, faces = sphere(0.02, 3)
    net = TouchNet(Surface(vertices, faces))
    batch = net.press(vertices[:3], noise_seed=[5, 6, 5]).rgb
    for row, seed in enumerate([5, 6, 5]):
        assert np.array_equal(batch[row], net.press(vertices[row : row + 1], noise_seed=seed).rgb[0])
    with pytest.raises(QueryError, match="noise_seed: 2 for 3 touches"):
        net.press(vertices[:3], noise_seed=[1, 2])
