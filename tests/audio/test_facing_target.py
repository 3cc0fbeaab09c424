"""Places of a surface that face a given way."""

import numpy as np
import pytest
import trimesh

from objectfolder.making.elements.facing_target import FacingTarget, rounding
from objectfolder.surface.surface import Surface


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


def directions(count: int) -> np.ndarray:
    vectors = np.random.default_rng(0).standard_normal((count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def test_triangles_of_a_ball_are_as_round_as_the_ball() -> None:
    """320 triangles cut up to 1.4 % off; bent to normals that are themselves estimated, a tenth of that."""
    ball = surface_of(trimesh.creation.icosphere(2, 1.0))
    points = directions(500)
    places, normals, hits = FacingTarget(ball).places(points, points, np.full(500, 0.3))
    assert hits.all()
    cut_off = ball.closest_points(points).distance.max()
    assert cut_off > 0.01
    assert np.abs(np.linalg.norm(places, axis=1) - 1).max() < 0.12 * cut_off
    assert np.einsum("ij,ij->i", normals, points).min() > np.cos(np.radians(1.5))


def test_what_triangles_cut_off_is_the_volume_that_a_ball_has_more() -> None:
    ball = surface_of(trimesh.creation.icosphere(3, 0.5))
    volume, depth = rounding(ball)
    lacking = np.pi / 6 - trimesh.Trimesh(ball.vertices, ball.faces).volume
    assert volume == pytest.approx(lacking, rel=0.02)
    assert depth == pytest.approx(lacking / np.pi, rel=0.02)
    inward, same_depth = rounding(Surface(ball.vertices, ball.faces[:, ::-1]))
    assert (inward, same_depth) == pytest.approx((-volume, depth), rel=1e-9)
    assert rounding(surface_of(trimesh.creation.box((2, 2, 2)))) == pytest.approx((0, 0), abs=1e-12)


@pytest.mark.parametrize(("sides", "round_share"), [(8, 0.0), (24, 1.0)])
def test_an_octagonal_leg_is_an_octagon_and_one_of_many_sides_is_round(
    sides: int, round_share: float
) -> None:
    leg = surface_of(trimesh.creation.cylinder(1.0, 4.0, sections=sides))
    angle = np.linspace(0, 2 * np.pi, 301)[:-1]
    points = np.stack([np.cos(angle), np.sin(angle), np.full(300, 0.1)], axis=1)
    outward = points * (1.0, 1.0, 0.0)
    places, _, hits = FacingTarget(leg).places(points, outward, np.full(300, 0.3))
    assert hits.all()
    flat = 1 - np.linalg.norm(leg.closest_points(points).points[:, :2], axis=1)
    bent = 1 - np.linalg.norm(places[:, :2], axis=1)
    assert np.abs(bent).max() == pytest.approx(
        (1 - round_share) * flat.max(), abs=0.3 * round_share * flat.max()
    )


def test_a_box_stays_flat_and_sharp() -> None:
    box = surface_of(trimesh.creation.box((2, 2, 2)))
    target = FacingTarget(box)
    random = np.random.default_rng(1)
    on_top = np.concatenate([random.uniform(-1, 1, (300, 2)), np.ones((300, 1))], axis=1)
    up = np.tile([0.0, 0.0, 1.0], (300, 1))
    places, normals, hits = target.places(on_top + 0.05 * up, up, np.full(300, 0.2))
    assert hits.all()
    np.testing.assert_allclose(places, on_top, atol=1e-12)
    np.testing.assert_allclose(normals, up, atol=1e-12)
    corner, near = target.creases(np.array([[0.9, 0.9, 0.3], [0.0, 0.0, 1.0]]), np.array([0.5, 0.5]))
    np.testing.assert_allclose(corner[0], [1, 1, 0.3], atol=1e-12)
    assert near.tolist() == [True, False]


def test_the_other_side_of_a_thin_wall_is_not_a_place() -> None:
    wall = FacingTarget(surface_of(trimesh.creation.box((1, 1, 0.01))))
    point, up = np.array([[0.1, 0.2, -0.004]]), np.array([[0.0, 0.0, 1.0]])
    places, _, hits = wall.places(point, up, np.array([0.1]))
    assert hits.all()
    assert places[0, 2] == pytest.approx(0.005)
    assert not wall.places(point, up, np.array([0.001]))[2].any()
