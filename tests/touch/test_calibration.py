"""A table is found again from images of a ball, made by the renderer with that table."""

import numpy as np
import pytest
from touch_shapes import psnr_db, sphere

from objectfolder.errors import InputError
from objectfolder.making.sensor.calibration import fit_table
from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.press import render_poses
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.sensor_file import read_sensor

SENSOR = read_sensor("gelsight").at_resolution(120, 160)
RADIUS, DEPTHS = 0.004, (0.0008, 0.0014)


def pressed_balls(sensor: Sensor, count: int, seed: int, radius: float = RADIUS):
    """Images of a ball at random places, with its centres and depths."""
    random = np.random.default_rng(seed)
    centres = random.uniform(-1, 1, (count, 2)) * [0.008, 0.006]
    depths = random.uniform(*DEPTHS, count)
    poses = np.tile(np.eye(4), (count, 1, 1))
    # The ball stays at the origin; the sensor moves.
    poses[:, 0, 3] = -(sensor.gel_apex_m[0] - depths + radius)
    poses[:, 1:3, 3] = -centres
    ball = Surface(*sphere(radius, 5))
    return np.stack([image.rgb for image in render_poses(ball, sensor, poses)]), centres, depths


@pytest.fixture(scope="module")
def fitted() -> Sensor:
    images, centres, depths = pressed_balls(SENSOR, 40, seed=1)
    table = fit_table(
        SENSOR,
        images,
        centres_m=centres,
        depths_m=depths,
        radius_m=RADIUS,
        untouched=no_contact_image(SENSOR),
    )
    return Sensor.from_dict({**SENSOR.to_dict(), "photometric_table": table.to_dict()})


def test_the_untouched_gel_is_found_again(fitted: Sensor) -> None:
    assert psnr_db(no_contact_image(SENSOR), no_contact_image(fitted)) > 50


def test_another_ball_elsewhere_looks_as_it_should(fitted: Sensor) -> None:
    truth, _, _ = pressed_balls(SENSOR, 6, seed=2, radius=0.006)
    answer, _, _ = pressed_balls(fitted, 6, seed=2, radius=0.006)
    touched = (truth != no_contact_image(SENSOR)).any(axis=-1)
    empty = np.broadcast_to(no_contact_image(SENSOR), truth.shape)
    assert psnr_db(truth, answer, touched) > 42
    assert psnr_db(truth, answer, touched) > psnr_db(truth, empty, touched) + 18


def test_what_cannot_be_fitted_is_refused() -> None:
    images, centres, depths = pressed_balls(SENSOR, 2, seed=1)
    untouched = no_contact_image(SENSOR)
    with pytest.raises(InputError, match="untouched"):
        fit_table(
            SENSOR, images[:, ::2], centres_m=centres, depths_m=depths, radius_m=RADIUS, untouched=untouched
        )
    with pytest.raises(InputError, match="not one for each image"):
        fit_table(
            SENSOR, images, centres_m=centres[:1], depths_m=depths, radius_m=RADIUS, untouched=untouched
        )
    with pytest.raises(InputError, match="in none"):
        fit_table(SENSOR, images, centres_m=centres, depths_m=-depths, radius_m=RADIUS, untouched=untouched)
