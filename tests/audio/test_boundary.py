"""Mode shapes read at points of a surface that is not quite the solid's."""

import numpy as np
import pytest
from structured_solids import box, moved, together

from objectfolder.audio.modes.boundary import Boundary
from objectfolder.audio.modes.spectrum import space_on

EPSILON_M = 1e-4
SLIT_M = 0.002


@pytest.fixture(scope="module")
def halves() -> tuple[Boundary, np.ndarray, np.ndarray]:
    """Two boxes with a slit between: fields (function, 3, 1) that tell the body, and that are linear."""
    half = box((3, 2, 1), (0.03, 0.02, 0.01))
    solid = together(half, moved(half, (0.03 + SLIT_M, 0.0, 0.0)))
    space, _ = space_on(solid, 2, 1.0)
    corners = solid.vertices
    body = np.zeros((space.size, 3, 1))
    body[: len(corners), :, 0] = solid.component[:, None]
    linear = np.zeros((space.size, 3, 1))
    linear[: len(corners), :, 0] = corners @ np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 1.0], [2.0, 0.0, -1.0]])
    return Boundary(solid, space, 1.0), body, linear


def test_a_web_over_a_slit_of_the_solid_moves_from_one_side_to_the_other(
    halves: tuple[Boundary, np.ndarray, np.ndarray],
) -> None:
    boundary, body, _ = halves
    x = np.linspace(0.028, 0.034, 1201)
    web = np.stack([x, np.full_like(x, 0.0131), np.full_like(x, 0.0103)], axis=1)
    field = boundary.evaluate(body, web, EPSILON_M)[0][:, 0, 0]
    assert field[0] == pytest.approx(0, abs=1e-9)
    assert field[-1] == pytest.approx(1, abs=1e-9)
    # With the nearest place alone one of these steps is 1.
    assert np.abs(np.diff(field)).max() < 0.05


def test_a_linear_field_is_met_up_to_two_epsilons_away(
    halves: tuple[Boundary, np.ndarray, np.ndarray],
) -> None:
    boundary, _, linear = halves
    samples = boundary.surface.sample(400, 3)
    away = np.linspace(-1.99, 1.99, 400)[:, None] * EPSILON_M
    points = samples.points + away * samples.normals
    slope = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 1.0], [2.0, 0.0, -1.0]])
    np.testing.assert_allclose(
        boundary.evaluate(linear, points, EPSILON_M)[0][:, :, 0], points @ slope, atol=1e-10
    )


def test_far_from_the_solid_a_field_does_not_grow(halves: tuple[Boundary, np.ndarray, np.ndarray]) -> None:
    boundary, _, linear = halves
    points = np.array([[0.015, 0.01, 0.0131], [0.015, 0.01, 0.02]])
    near = boundary.surface.closest_points(points).points
    fields = boundary.evaluate(linear, points, EPSILON_M)[0][:, :, 0]
    at_places = boundary.evaluate(linear, near, EPSILON_M)[0][:, :, 0]
    assert np.linalg.norm(fields - at_places, axis=1).max() < 0.03


def test_points_within_epsilon_are_alone(halves: tuple[Boundary, np.ndarray, np.ndarray]) -> None:
    """Nothing that is farther changes what is read there."""
    boundary, body, _ = halves
    lip = np.array([[0.03 + 0.5 * EPSILON_M, 0.007, 0.004]])
    assert boundary.evaluate(body, lip, EPSILON_M)[0][0, 0, 0] == pytest.approx(0, abs=1e-12)
