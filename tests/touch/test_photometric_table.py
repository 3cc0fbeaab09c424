import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from touch_shapes import sphere

from objectfolder.errors import FormatError
from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.press import press
from objectfolder.touch.presses.touches import Press
from objectfolder.touch.sensor.illumination import Illumination, Strip, membrane_normals, photometric_table
from objectfolder.touch.sensor.photometric_table import PhotometricTable, place_terms
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.sensor_file import read_sensor

FLAT = Sensor(gel_sagitta_m=0.0, light_positions_m=(), light_colours=())


def random_table(seed: int = 0, slopes: int = 4, directions: int = 5) -> PhotometricTable:
    coefficients = np.random.default_rng(seed).uniform(0, 0.15, (3, slopes, directions, 6))
    coefficients[:, 0] = coefficients[:, 0, :1]
    return PhotometricTable(coefficients.astype(np.float16))


def test_at_its_nodes_a_table_gives_its_polynomials() -> None:
    table = random_table()
    across, up = np.array([0.3]), np.array([-0.6])
    for i in range(4):
        for j in range(5):
            value = table.values(np.array([i * np.pi / 6]), np.array([j * 2 * np.pi / 5]), across, up)
            exact = table.coefficients[:, i, j].astype(float) @ place_terms(across, up)[0]
            assert value[0] == pytest.approx(np.clip(exact, 0, 1), abs=1e-6)


@given(st.floats(0, np.pi / 2), st.floats(-10, 10))
def test_directions_are_periodic_and_values_continuous(slope: float, direction: float) -> None:
    table = random_table()
    zero = np.zeros(3)
    slopes = np.array([slope, slope, min(slope + 1e-5, np.pi / 2)])
    directions = np.array([direction, direction + 2 * np.pi, direction + 1e-5])
    values = table.values(slopes, directions, zero, zero)
    assert np.abs(values - values[0]).max() < 1e-4


def test_flat_there_is_no_direction_and_beyond_the_vertical_no_more_slope() -> None:
    table = random_table()
    angles = np.linspace(-np.pi, np.pi, 9)
    at = np.full(9, 0.4)
    assert np.ptp(table.values(np.zeros(9), angles, at, at), axis=0).max() < 1e-6
    vertical = table.values(np.full(9, np.pi / 2), angles, at, at)
    assert np.array_equal(table.values(np.full(9, 3.0), angles, at, at), vertical)


def test_a_distant_light_gives_lamberts_law() -> None:
    # One light a kilometre away, 30 degrees from the axis, towards the image's top right.
    light = np.array([-np.cos(np.pi / 6), -0.5 * np.sqrt(0.5), 0.5 * np.sqrt(0.5)])
    far = tuple(float(x) for x in 1000 * light)
    strip = Strip((far, far), (1.0, 1.0, 1.0), points=1)
    lit = Illumination((strip,), ambient=0.0, centre_value=0.5, display_gamma=1.0, slopes=31, directions=60)
    table = photometric_table(FLAT, lit)
    random = np.random.default_rng(2)
    slope, direction = random.uniform(0, np.pi / 2, 500), random.uniform(0, 2 * np.pi, 500)
    across, up = random.uniform(-1, 1, (2, 500))
    exact = 0.5 * np.maximum(membrane_normals(slope, direction) @ light, 0) / np.cos(np.pi / 6)
    values = table.values(slope, direction, across, up)
    # Linear interpolation of a cosine over 6 degrees, and of the edge of its own shadow.
    assert np.abs(values - exact[:, None]).max() < 0.006


def test_a_near_light_is_brighter_nearby() -> None:
    at = (FLAT.gel_apex_m[0] - 0.01, -0.02, 0.015)
    lit = Illumination((Strip((at, at), (1.0, 1.0, 1.0), points=1),), ambient=0.0, display_gamma=1.0)
    apex = np.asarray(FLAT.gel_apex_m)
    points = apex + np.array([[0, 0, 0], [0, -0.01, 0]])
    inwards = np.array([[-1.0, 0, 0]] * 2)
    # At heights h and distances d a diffuse surface gets h / d^3.
    ratio = (0.01 / (0.01**2 + 0.01**2) ** 1.5) / (0.01 / (0.01**2 + 0.02**2) ** 1.5)
    values = lit.pixel_values(FLAT, points, inwards)
    assert values[0] == pytest.approx(0.45)
    assert values[1] == pytest.approx(min(0.45 * ratio, 1.0))


def test_a_ball_in_a_flat_gel_shows_the_table_at_the_balls_own_slopes() -> None:
    sensor = read_sensor("gelsight")
    radius, depth = 0.006, 0.001
    touch = press(
        Surface(*sphere(radius, 6)), sensor, np.array([[0.0, 0.0, radius]]), Press(depth_m=depth, samples=1)
    )
    rows, columns = sensor.image_height, sensor.image_width
    pitch = 2 * np.tan(np.radians(sensor.field_of_view_deg) / 2) / rows
    right, up = np.meshgrid((np.arange(columns) - columns / 2 + 0.5), (rows / 2 - 0.5 - np.arange(rows)))
    right, up = right * pitch, up * pitch
    # Rays from the camera, x = 1, meet the ball round x = centre.
    centre = sensor.gel_apex_m[0] - depth + radius
    a = 1 + right**2 + up**2
    root = centre**2 - a * (centre**2 - radius**2)
    x = (centre - np.sqrt(np.maximum(root, 0))) / a
    inside = (root > 0) & (x < sensor.gel_apex_m[0] - 1e-4)
    right, up, x = right[inside], up[inside], x[inside]
    off = np.hypot(right * x, up * x)
    table = sensor.photometric_table
    assert table is not None
    half = sensor.gel_width_m / 2, sensor.gel_height_m / 2
    slope, direction = np.arcsin(off / radius), np.arctan2(up, right)
    exact = table.values(slope, direction, right * x / half[0], up * x / half[1])
    assert inside.sum() > 5000
    assert np.abs(touch.rgb[0][inside] - 255 * exact).max() < 2.5
    assert touch.mask[0].sum() * (pitch * sensor.gel_apex_m[0]) ** 2 == pytest.approx(
        np.pi * (2 * radius * depth - depth**2), rel=0.01
    )


def test_a_table_survives_json_and_nothing_else_is_read() -> None:
    table = random_table()
    stored = table.to_dict()
    assert PhotometricTable.from_dict(stored) == table
    assert random_table(1) != table
    for wrong in ({}, {**stored, "shape": [3, 4]}, {**stored, "float16": "not base 64"}, {"shape": [1]}):
        with pytest.raises(FormatError, match="photometric table"):
            PhotometricTable.from_dict(wrong)


def test_a_table_of_another_type_is_refused() -> None:
    with pytest.raises(ValueError, match="float32, expected float16"):
        PhotometricTable(random_table().coefficients.astype(np.float32))
