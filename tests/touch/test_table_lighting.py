import numpy as np
import pytest

from objectfolder.touch.sensor.sensor_file import read_sensor
from objectfolder.touch.sensor.shading import look_up
from objectfolder.touch.sensor.table_lighting import table_lighting

SENSOR = read_sensor("gelsight")


def looked_up(normals: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    table = SENSOR.photometric_table
    assert table is not None
    normals, positions = normals.astype(np.float32), positions.astype(np.float32)
    compiled = table_lighting(SENSOR, table).shade(normals.shape[1], positions, normals)
    return compiled, look_up(SENSOR, table, positions, normals).T


def test_compiled_look_ups_are_those_of_the_reference() -> None:
    random = np.random.default_rng(0)
    normals = random.normal(size=(3, 4000))
    extent = np.array([[0.002], [SENSOR.gel_width_m], [SENSOR.gel_height_m]])
    positions = np.asarray(SENSOR.gel_apex_m)[:, None] + random.uniform(-0.5, 0.5, (3, 4000)) * extent
    compiled, reference = looked_up(normals, positions)
    assert compiled.shape == (3, 4000)
    # Single precision, in another order.
    np.testing.assert_allclose(compiled, reference, atol=3e-6)


def test_flat_vertical_and_turned_away(subtests: pytest.Subtests) -> None:
    for normal in [(-1, 0, 0), (-1, -0.0, -0.0), (0, 1, 0), (0, 0, -1), (0.9, 0.3, -0.2), (-1, 1e-30, 0)]:
        with subtests.test(normal=normal):
            compiled, reference = looked_up(np.array([normal]).T, np.array([SENSOR.gel_apex_m]).T)
            np.testing.assert_allclose(compiled, reference, atol=3e-6)


def test_only_as_many_as_asked_for() -> None:
    table = SENSOR.photometric_table
    assert table is not None
    points = np.zeros((3, 10), dtype=np.float32)
    assert table_lighting(SENSOR, table).shade(0, points, points - 1).shape == (3, 0)
    assert table_lighting(SENSOR, table).shade(4, points, points - 1).shape == (3, 4)
