from functools import cache

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


def dense_indentation(triangle: np.ndarray, sensor: Sensor, steps: int = 400) -> float:
    """Largest indentation over a grid of points of the triangle that lie under the gel."""
    i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1))
    i, j = i[i + j <= steps], j[i + j <= steps]
    points = np.stack([steps - i - j, i, j], axis=1) / steps @ triangle
    under = (np.abs(points[:, 1]) <= 0.01) & (np.abs(points[:, 2] - 0.015) <= 0.015) & (points[:, 0] >= 0.001)
    gap = gel_surface(sensor, points[under, 1], points[under, 2]) - points[under, 0]
    return float(gap.max(initial=-np.inf))


@cache
def dense_search(size: float) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of about a size round the gel, and their largest indentations over grids of points."""
    random = np.random.default_rng(int(size * 1e4))
    centres = np.array([0.022, 0, 0.015]) + random.normal(size=(150, 1, 3)) * [0.003, 0.006, 0.009]
    triangles = centres + random.normal(size=(150, 3, 3)) * [0.2 * size, size, size]
    return triangles, np.array([dense_indentation(triangle, Sensor()) for triangle in triangles])


@pytest.mark.parametrize("size", [0.002, 0.02, 0.1])
def test_indentations_are_the_maxima_of_a_dense_search(size: float) -> None:
    sensor = Sensor()
    triangles, dense = dense_search(size)
    found = indentations(triangles, sensor)
    hit = np.isfinite(dense)
    assert hit.sum() > 60
    ahead = hit & (triangles[:, :, 0].min(axis=1) > 0.001)
    assert (found[ahead] >= dense[ahead] - 1e-12).all()
    # What reaches behind the camera fills the sensor: by how much does not matter.
    assert (found[hit] >= np.minimum(dense[hit], 0.0155) - 1e-12).all()
    # A grid of 1/400 of the triangle misses the maximum by about that part of its slope.
    assert (found[ahead] - dense[ahead] <= size / 100).all()
    assert np.median(found[ahead] - dense[ahead]) < size / 2000


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


def test_meeting_the_housing_agrees_with_a_search_over_points() -> None:
    sensor, random = Sensor(), np.random.default_rng(5)
    low, high = np.array(sensor.housing_low_m), np.array(sensor.housing_high_m)
    weights = random.dirichlet([0.7, 0.7, 0.7], 20000)
    wrong = 0
    for _ in range(300):
        triangle = (low + high) / 2 + random.normal(size=(1, 3)) * 0.03 + random.normal(size=(3, 3)) * 0.02
        points = weights @ triangle
        inside = bool(((points > low) & (points < high)).all(axis=1).any())
        exact = meets_housing(triangle[None], sensor)
        assert exact or not inside
        wrong += exact != inside
    assert wrong <= 3


def test_a_face_that_only_touches_the_housing_does_not_meet_it() -> None:
    vertices, faces = box((0.015, -0.1, -0.1), (0.02, 0.1, 0.1))
    assert not meets_housing(vertices[faces], Sensor())
    assert meets_housing((vertices - [1e-6, 0, 0])[faces], Sensor())
