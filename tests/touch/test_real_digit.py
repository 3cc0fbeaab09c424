"""The preset of a real DIGIT: bright where it is lit, dark where a lamp is hidden, as in its photographs."""

import numpy as np
from touch_shapes import sphere

from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.press import render_poses
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.reading import background_kernel, calibrated
from objectfolder.touch.sensor.sensor_file import read_sensor

RADIUS, DEPTH = 0.00235, 0.0014


def test_flanks_and_shadows_have_the_colours_of_the_photographs() -> None:
    sensor = read_sensor("digit").at_resolution(320, 240)
    pose = np.eye(4)
    pose[:3, 3] = -np.asarray(sensor.gel_apex_m) - np.array([RADIUS - DEPTH, 0, 0])
    picture = render_poses(Surface(*sphere(RADIUS, 5)), sensor, pose[None])[0].rgb
    grey = np.full_like(picture, 100)
    change = calibrated(picture, no_contact_image(sensor), grey, sensor).astype(int) - 100
    row, column, flank, beyond = 160, 120, 20, 48  # pixels, of 18.8 a millimetre

    def at(angle_deg: float, distance: int) -> np.ndarray:
        """Mean change of red, green and blue; angles from the image's right towards its top."""
        turn = np.radians(angle_deg)
        i, j = int(row - distance * np.sin(turn)), int(column + distance * np.cos(turn))
        return np.asarray(change[i - 3 : i + 4, j - 3 : j + 4].mean(axis=(0, 1)))

    for channel, towards in ((0, 45.0), (1, 140.0), (2, 265.0)):
        assert at(towards, flank)[channel] > 35
        assert int(np.argmax(at(towards, flank))) == channel
        assert at(towards + 180, beyond)[channel] < -5  # the shadow, beyond the contact


def test_its_blur_is_a_length_on_the_gel_at_any_size() -> None:
    for height, width in ((160, 120), (320, 240)):
        sensor = read_sensor("digit").at_resolution(height, width)
        weights = background_kernel(sensor)
        places = np.arange(len(weights)) - len(weights) // 2
        metre = 0.0188 * height / 320 * 1e6  # pixels
        spread = np.sqrt((weights * places**2).sum()) / metre
        assert abs(spread / sensor.background_blur_m - 1) < 0.03
