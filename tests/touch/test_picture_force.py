from dataclasses import replace

import numpy as np
import pytest
from touch_shapes import box, sphere

from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface
from objectfolder.touch import MarkerGrid, Markers, Press, Sensor, force_of, press, read_sensor
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.magnification import pixels_per_metre

DIGIT = read_sensor("digit").at_resolution(80, 60)


@pytest.mark.parametrize("sensor", [DIGIT, Sensor().at_resolution(80, 60)], ids=["shadows", "none"])
def test_the_force_of_an_ellipsoid_is_that_of_its_picture(sensor: Sensor) -> None:
    vertices, faces = sphere(1.0, 4)
    egg = Surface(vertices * [0.008, 0.005, 0.011], faces)
    touch = press(egg, sensor, np.array([[0.0005, 0.001, 0.011]]), Press(force_n=1.3, roll_deg=40))
    force, error = force_of(touch.rgb[0], sensor)
    assert abs(force - touch.force_n[0]) < error < 0.15 * touch.force_n[0]
    assert 0 < touch.force_error_n[0] < 0.05 * touch.force_n[0]


@pytest.mark.slow
def test_a_calibrated_sensor_tells_the_force_by_the_contact_alone() -> None:
    sensor = read_sensor("gelsight-fots").at_resolution(120, 90)
    assert sensor.indentation_response is not None
    vertices, faces = sphere(1.0, 4)
    egg = Surface(vertices * [0.006, 0.004, 0.005], faces)
    point, pin = np.array([[0.0005, 0.001, 0.005]]), Surface(*box((-0.001, -0.001, 0), (0.001, 0.001, 0.006)))
    touch = press(egg, sensor, point, Press(force_n=0.5, roll_deg=40))
    force, error = force_of(touch.rgb[0], sensor)
    assert abs(force / touch.force_n[0] - 1) < 0.1
    assert error == pytest.approx(0.25 * force)
    grid = MarkerGrid(8, 7, 0.0025, 0.0025, 1.0, 0.0, 0.0, 0.0003)
    with_markers, scale = replace(sensor, marker_grid=grid), pixels_per_metre(sensor)
    places, nothing = np.array([59.5, 44.5]) + grid.places_m() * scale, np.zeros((56, 3))
    dots = Markers(nothing, nothing, places, places, grid.dot_radius_m * scale).drawn_on(touch.rgb[0])
    assert force_of(dots, with_markers).force_n == pytest.approx(force, rel=0.06)
    assert force_of(touch.rgb[0], with_markers).force_n == force
    assert force_of(no_contact_image(sensor, 1), sensor) == (0.0, 0.0)
    walls = press(pin, sensor, np.array([[0.0, 0.0, 0.006]]), Press(force_n=0.8))
    with pytest.raises(QueryError, match=r"steep walls|no round contact"):
        force_of(walls.rgb[0], sensor)


def test_what_a_picture_does_not_tell_is_said() -> None:
    assert force_of(no_contact_image(DIGIT, 1), DIGIT) == (0.0, 0.0)
    pin = Surface(*box((-0.001, -0.001, 0), (0.001, 0.001, 0.006)))
    touch = press(pin, DIGIT, np.array([[0.0, 0.0, 0.006]]), Press(force_n=1.5))
    with pytest.raises(QueryError, match="steep walls"):
        force_of(touch.rgb[0], DIGIT)
    with pytest.raises(QueryError, match="uint8"):
        force_of(touch.rgb[0][:-1], DIGIT)
