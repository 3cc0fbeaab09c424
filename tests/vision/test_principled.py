"""Light reflected once by a known material: shares of energy, and what no material may do."""

import numpy as np
import pytest

from objectfolder.vision.cameras import sub_ray_offsets
from objectfolder.vision.compiled.lighting import Points
from objectfolder.vision.compiled.principled import Principled
from objectfolder.vision.network.directional_albedo import reflected_by_white

WHITE, GREY = np.ones((1, 3)), np.full((1, 3), 0.5)


def points(cosine: float, count: int) -> Points:
    """A point as often as there are lights, seen from an angle of this cosine with its normal."""
    upright = np.tile([0.0, 0.0, 1.0], (count, 1))
    rays = np.tile([-np.sqrt(1 - cosine**2), 0.0, -cosine], (count, 1))
    face = np.zeros(count, dtype=np.int64)
    return Points(face, np.zeros((count, 3)), rays, np.zeros((count, 3)), upright, upright, np.ones(count))


def lights() -> np.ndarray:
    """Directions (n, 3) all round the normal, as dense as their cosine."""
    first, second = sub_ray_offsets(40_000).T
    radius, angle = np.sqrt(first), 2 * np.pi * second
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - first)], axis=1)


def reflected(
    cosine: float, roughness: float, metallic: float, base: np.ndarray, specular: float = 0.5
) -> tuple[np.ndarray, np.ndarray]:
    """Return the shares of light from all round that the matt part and the gloss reflect, a mean each."""
    directions = lights()
    places = points(cosine, len(directions))
    model = Principled(specular, (roughness,))
    constant = np.full((2, len(directions)), [[roughness], [metallic]])
    terms = model.terms(places, np.repeat(base, len(directions), axis=0), *constant)
    even, gloss = model.reflected(places, terms, np.arange(len(directions)), directions)
    return base[0] * even.mean(axis=0), gloss.mean(axis=0)


@pytest.mark.parametrize("cosine", [0.3, 0.9])
@pytest.mark.parametrize("roughness", [0.4, 0.9])
def test_a_white_surface_loses_nothing(cosine, roughness):
    for metallic in (0.0, 1.0):
        matt, gloss = reflected(cosine, roughness, metallic, WHITE)
        np.testing.assert_allclose(matt + gloss, 1.0, atol=0.02)


def test_what_a_metal_loses_in_one_reflection_is_tabulated():
    share, _ = reflected_by_white([28 / 31])
    model = Principled(0.5, (28 / 31,))
    # Nothing is lost, so nothing comes back.
    model._white, model._mean = np.ones((32, 32)), np.ones(32)
    directions = lights()
    places = points(20 / 31, len(directions))
    unit = np.ones(len(directions))
    terms = model.terms(places, np.repeat(WHITE, len(unit), axis=0), unit * 28 / 31, unit)
    _, gloss = model.reflected(places, terms, np.arange(len(unit)), directions)
    assert share[28, 20] < 0.7
    np.testing.assert_allclose(gloss.mean(axis=0), share[28, 20], atol=0.01)


def test_lambert_without_a_coat_and_nothing_from_behind():
    matt, gloss = reflected(0.6, 0.5, 0.0, GREY, specular=0.0)
    np.testing.assert_allclose(matt, 0.5, atol=1e-6)
    np.testing.assert_allclose(gloss, 0.0, atol=1e-6)
    places = points(0.6, 1)
    model = Principled(0.5, (0.5,))
    terms = model.terms(places, GREY, np.array([0.5]), np.array([0.0]))
    _, behind = model.reflected(places, terms, np.zeros(1, dtype=np.int64), np.array([[0.0, 0.6, -0.8]]))
    np.testing.assert_array_equal(behind, 0.0)
