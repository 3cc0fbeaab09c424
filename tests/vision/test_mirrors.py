"""Surfaces that show themselves: mirror rays against closed forms, and both ways to render them."""

import numpy as np
import pytest
from compiled_cases import SHAPES, joined, network
from vision_shapes import sphere

from objectfolder.geometry.frames import UnitFrame
from objectfolder.vision.cameras import look_at, pixel_rays, sub_ray_offsets
from objectfolder.vision.compiled import CompiledRenderer
from objectfolder.vision.incidence import UnitSurface
from objectfolder.vision.reference_renderer import ReferenceRenderer

WHITE = np.ones((1, 3))


def rays(position: tuple[float, ...], size: int = 40) -> tuple[np.ndarray, np.ndarray]:
    return pixel_rays(look_at(np.array([position]))[0], np.arange(size**2), sub_ray_offsets(1), size, 39.6)


def corner_of_mirrors() -> UnitSurface:
    """Two squares of side 1 that meet at a right angle along y: every ray leaves as it came."""
    floor = np.array([[-0.5, -0.5, -0.5], [0.5, -0.5, -0.5], [0.5, 0.5, -0.5], [-0.5, 0.5, -0.5]])
    wall = floor[:, [2, 1, 0]]
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    surface = joined([(floor, quad), (wall, quad[:, ::-1])])
    return UnitSurface(surface, UnitFrame.of_points(surface.vertices))


def test_a_corner_of_mirrors_shows_what_the_law_of_reflection_says():
    surface = corner_of_mirrors()
    origins, directions = rays((1.5, 0.2, 0.9))
    face, barycentric = surface.first_hits(origins, directions)
    hit = face >= 0
    points = surface.incidence(face[hit], barycentric[hit], directions[hit], np.array([0.5, 0.1, 0.7]))
    met = surface.mirrored(face[hit], points)
    floor = face[hit] < 2
    turned = directions[hit] * np.where(floor[:, None], [1, 1, -1], [-1, 1, 1])
    np.testing.assert_allclose(met.direction, turned[met.row], atol=1e-9)
    # From the floor to the wall and from the wall to the floor, where they are met within their squares.
    start = points.position[met.row]
    axis = np.where(floor[met.row], 0, 2)
    along = (-0.5 - np.take_along_axis(start, axis[:, None], 1)) / np.take_along_axis(
        met.direction, axis[:, None], 1
    )
    position, _ = surface.seen(met.face, met.barycentric, met.direction)
    np.testing.assert_allclose(position, start + along * met.direction, atol=1e-3)
    assert (floor[met.row] == (met.face >= 2)).all()
    assert len(met.row) > 100


def test_a_ball_does_not_see_itself():
    ball = sphere(0.5, (200, 200, 200)).surface
    surface = UnitSurface(ball, UnitFrame.of_points(ball.vertices))
    origins, directions = rays((1.5, 0.2, 0.9))
    face, barycentric = surface.first_hits(origins, directions)
    hit = face >= 0
    points = surface.incidence(face[hit], barycentric[hit], directions[hit], np.array([0.0, 0.0, 1.0]))
    assert len(surface.mirrored(face[hit], points).row) == 0


@pytest.mark.parametrize("shape", ["mug", "furniture"])
def test_both_ways_show_the_surface_in_itself(shape):
    surface, grid, weights = network(SHAPES[shape](), mirrors=True)
    slow, fast = ReferenceRenderer(surface, grid, weights, 1.0), CompiledRenderer(surface, grid, weights)
    lights = np.array([[0.3, 0.2, 0.9], [-0.5, -0.7, 0.4]])
    origins, directions = rays((0.8, -1.2, 1.9))
    colours = np.array([[1.0, 0.5, 0.2], [0.3, 0.9, 0.6]])
    expected = slow.radiance(origins, directions, lights, colours)
    answer = fast.radiance(origins, directions, lights, colours)
    off = np.abs(answer - expected).max(axis=1) > 2e-3 * (1 + np.abs(expected).max(axis=1))
    assert off.mean() < 2e-3
    # Without what is seen in the mirror it would be another image.
    no_mirrors = weights | {"facing.bias": np.full(3, -60.0), "facing.weight": 0 * weights["facing.weight"]}
    without = ReferenceRenderer(surface, grid, no_mirrors, 1.0).radiance(origins, directions, lights, colours)
    assert np.abs(without - expected).max() > 0.05
    pose = look_at(np.array([[0.8, -1.2, 1.9]]))[0]
    image = fast.image(pose, lights, colours, (24, 24), 39.6, 64)
    truth = slow.render(pose, lights, colours, (24, 24), 39.6, 256)
    assert np.sqrt(((image - truth) ** 2).mean()) < 0.02
