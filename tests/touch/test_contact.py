import numpy as np
import pytest
from touch_shapes import box

from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.indentation import indentation
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.sensor.gel import gel_constants, gel_surface
from objectfolder.touch.sensor.sensor import Sensor


def indentations(triangles: np.ndarray, sensor: Sensor) -> np.ndarray:
    gel, working = gel_constants(sensor), np.empty((3, 3))
    return np.array([indentation(triangle, gel, working) for triangle in triangles])


def meets_housing(triangles: np.ndarray, sensor: Sensor) -> bool:
    patches = FacePatches(Surface(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)))
    return patches.enters_box(np.eye(4), np.array(sensor.housing_low_m), np.array(sensor.housing_high_m))


def test_a_face_that_reaches_behind_the_camera_fills_the_sensor() -> None:
    """Against a grid of points of each face: no less, or no less than the gel is deep."""
    random, sensor = np.random.default_rng(1000), Sensor()
    centres = np.array([0.022, 0, 0.015]) + random.normal(size=(80, 1, 3)) * [0.003, 0.006, 0.009]
    triangles = centres + random.normal(size=(80, 3, 3)) * [0.02, 0.1, 0.1]
    i, j = np.meshgrid(np.arange(101), np.arange(101))
    shares = np.stack([100 - i - j, i, j], axis=-1)[i + j <= 100] / 100
    x, y, z = np.moveaxis(shares @ triangles, 2, 0)
    under = (np.abs(y) <= 0.01) & (np.abs(z - 0.015) <= 0.015) & (x >= 0.001)
    dense = np.where(under, gel_surface(sensor, y, z) - x, -np.inf).max(axis=1)
    behind = np.isfinite(dense) & (triangles[:, :, 0].min(axis=1) < 0.001)
    assert behind.sum() > 15
    assert (indentations(triangles[behind], sensor) >= np.minimum(dense[behind], 0.0155) - 1e-12).all()


def test_an_edge_along_the_axis_indents_as_its_end() -> None:
    triangle = np.array([[[0.021, 0, 0.015], [0.03, 0, 0.015], [0.03, 0, 0.0151]]])
    assert indentations(triangle, Sensor()) == pytest.approx([0.001])


@pytest.mark.parametrize("rounding", [0.0, 1e-19, -3e-18, 1e-13])
def test_a_face_on_edge_but_for_rounding_indents_as_its_edges(rounding: float) -> None:
    # Along the axis and along z, past both borders of the gel.
    corners = [[0.0215, 0, -0.01], [0.0215, rounding, 0.04], [0.04, 0, 0.015]]
    assert indentations(np.array([corners]), Sensor()) == pytest.approx([0.0005], abs=1e-9)


def test_a_triangle_beside_the_gel_does_not_indent_it() -> None:
    triangle = np.array([[[0.01, 0.02, 0.0], [0.01, 0.03, 0.0], [0.01, 0.02, 0.03]]])
    assert indentations(triangle, Sensor())[0] == -np.inf


def test_a_face_that_only_touches_the_housing_does_not_meet_it() -> None:
    vertices, faces = box((0.015, -0.1, -0.1), (0.02, 0.1, 0.1))
    assert not meets_housing(vertices[faces], Sensor())
    assert meets_housing((vertices - [1e-6, 0, 0])[faces], Sensor())
