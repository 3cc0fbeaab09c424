"""Drafts in environments: light in a bowl as theory has it, whatever its turn."""

import numpy as np
from scipy.spatial.transform import Rotation
from small_visionnets import MATT, Even
from vision_shapes import sphere

from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.compiled.drafts import DRAFT_BOUNCES, Draft
from objectfolder.vision.compiled.known_light import KnownLight
from objectfolder.vision.compiled.lighting import LitSurface
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.incidence import UnitSurface

EVEN = Environment.of(np.ones((8, 16, 3)))


def half_ball(way: int) -> tuple[Surface, Draft]:
    """The lower half of a ball, which looks outwards (1) or inwards (-1), and its draft."""
    ball = sphere(0.5, (255, 255, 255), 3)
    below = ball.vertices[ball.faces].mean(axis=1)[:, 2] < 0
    faces, normals = ball.faces[below][:, ::way], way * ball.surface.corner_normals[below][:, ::way]
    surface = Surface(ball.vertices, faces, normals=normals)
    unit = UnitSurface(surface, UnitFrame.of_points(ball.vertices))
    lit = LitSurface(unit)
    return surface, Draft(lit, unit, KnownLight(lit, unit, Even(None, MATT)))


def test_half_of_a_white_furnace_reaches_all_of_a_bowl_and_comes_back_from_the_other_half():
    """From any point inside a sphere's surface any half of the surface is half of what it sees."""
    _, draft = half_ball(-1)
    share, bounced = np.split(draft.light(EVEN, np.eye(3)), 2, axis=1)
    np.testing.assert_allclose(share.mean(), 0.5, atol=0.015)
    assert share.std() < 0.05
    albedo = float(draft._albedo.mean())
    series = 0.5 * sum((0.5 * albedo) ** bounce for bounce in range(1, DRAFT_BOUNCES + 1))
    np.testing.assert_allclose(bounced.mean(), series, rtol=0.05)


def test_nothing_hides_a_furnace_from_a_convex_side():
    share, bounced = np.split(half_ball(1)[1].light(EVEN, np.eye(3)), 2, axis=1)
    np.testing.assert_allclose(share, 1.0, atol=1e-6)
    assert not bounced.any()


def test_a_turned_bowl_sees_the_sky_where_it_is():
    """A quarter turn about z moves columns of a map by a quarter of them."""
    surface, draft = half_ball(-1)
    sky = np.random.default_rng(0).random((16, 32, 3)) * (np.arange(32) < 8)[:, None]
    quarter = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    sample = surface.sample(100, seed=1)
    points = draft._lit.points(sample.face, sample.barycentric, -sample.normals)
    turned = draft.radiance(points, Environment.of(sky), quarter)
    as_seen = draft.radiance(points, Environment.of(np.roll(sky, 8, axis=1)), np.eye(3))
    np.testing.assert_allclose(turned, as_seen, rtol=1e-4, atol=1e-5)
    assert turned.std() > 0.01
