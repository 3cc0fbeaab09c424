"""Mode shapes read at points of a surface that is not quite the solid's."""

import numpy as np
import pytest
from structured_solids import box, moved, together

from objectfolder.making.modes.boundary import Boundary
from objectfolder.making.modes.spectrum import space_on

EPSILON_M = 1e-4
SLIT_M = 0.002


@pytest.fixture(scope="module")
def halves() -> tuple[Boundary, np.ndarray]:
    """Two boxes with a slit between: a linear field (function, 3, 1)."""
    half = box((3, 2, 1), (0.03, 0.02, 0.01))
    solid = together(half, moved(half, (0.03 + SLIT_M, 0.0, 0.0)))
    space, _ = space_on(solid, 2, 1.0)
    corners = solid.vertices
    linear = np.zeros((space.size, 3, 1))
    linear[: len(corners), :, 0] = corners @ np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 1.0], [2.0, 0.0, -1.0]])
    return Boundary(solid, space, 1.0), linear


def test_a_linear_field_is_met_up_to_two_epsilons_away(
    halves: tuple[Boundary, np.ndarray],
) -> None:
    boundary, linear = halves
    samples = boundary.surface.sample(400, 3)
    away = np.linspace(-1.99, 1.99, 400)[:, None] * EPSILON_M
    points = samples.points + away * samples.normals
    slope = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 1.0], [2.0, 0.0, -1.0]])
    np.testing.assert_allclose(
        boundary.evaluate(linear, points, EPSILON_M)[0][:, :, 0], points @ slope, atol=1e-10
    )


def test_far_from_the_solid_a_field_does_not_grow(halves: tuple[Boundary, np.ndarray]) -> None:
    boundary, linear = halves
    points = np.array([[0.015, 0.01, 0.0131], [0.015, 0.01, 0.02]])
    near = boundary.surface.closest_points(points).points
    fields = boundary.evaluate(linear, points, EPSILON_M)[0][:, :, 0]
    at_places = boundary.evaluate(linear, near, EPSILON_M)[0][:, :, 0]
    assert np.linalg.norm(fields - at_places, axis=1).max() < 0.03
