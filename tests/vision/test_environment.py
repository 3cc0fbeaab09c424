"""Environment maps as lights: furnaces of known irradiance, a sun, and what a finite radius costs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_visionnets import drawn_visionnet
from vision_shapes import cube

from objectfolder.errors import QueryError
from objectfolder.vision.cameras import look_at, uniform_on_sphere
from objectfolder.vision.truth.environment import environment_lights, pixel_directions

# The data set's 20 W light.
POWER_W = 20.0
SCALE = POWER_W / (4 * np.pi**2)


def irradiance(
    positions: np.ndarray, colours: np.ndarray, place: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """The irradiance (3,) of point lights of power colour * POWER_W, by the inverse square law."""
    towards = positions - place
    distance = np.linalg.norm(towards, axis=1)
    cosine = np.maximum(towards @ normal / distance, 0)
    return (colours * POWER_W * (cosine / (4 * np.pi * distance**2))[:, None]).sum(axis=0)


def test_solid_angles_fill_the_sphere_and_directions_are_blender_s() -> None:
    directions, solid_angle = pixel_directions(32, 64)
    assert solid_angle.sum() * 64 == pytest.approx(4 * np.pi, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)
    assert directions[0, 0, 2] > 0.99
    assert directions[31, 0, 2] < -0.99
    np.testing.assert_allclose(directions[15:17, 31:33].mean(axis=(0, 1)), [1, 0, 0], atol=3e-3)
    np.testing.assert_allclose(directions[15:17, 15:17].mean(axis=(0, 1)), [0, 1, 0], atol=3e-3)
    # The mean over the sphere of n n^T is a third of the identity.
    second = np.einsum("hwi,hwj,h->ij", directions, directions, solid_angle) / (4 * np.pi)
    np.testing.assert_allclose(second, np.eye(3) / 3, atol=1e-3)


@pytest.mark.parametrize(("count", "within"), [(64, 0.05), (256, 0.02), (1024, 0.006)])
@pytest.mark.parametrize("radius", [1.0, 2.0])
def test_a_white_furnace_has_the_irradiance_pi_l(count: int, within: float, radius: float) -> None:
    radiance = np.array([3.0, 2.0, 0.5])
    environment = np.broadcast_to(radiance, (64, 128, 3))
    lights, colours = environment_lights(environment, count, radiance_scale=SCALE, radius=radius)
    assert len(lights) == count
    np.testing.assert_allclose(np.linalg.norm(lights, axis=1), radius)
    for normal in uniform_on_sphere(20, 1.0, np.random.default_rng(0)):
        found = irradiance(lights, colours, np.zeros(3), normal)
        np.testing.assert_allclose(found, np.pi * radiance, rtol=within)


@pytest.mark.parametrize(("place", "radius"), [(0.5, 2.0), (0.866, 2.0), (0.5, 4.0), (0.5, 1.0)])
def test_a_finite_radius_errs_by_no_more_than_it_says(place: float, radius: float) -> None:
    environment = np.ones((256, 512, 3))
    lights, colours = environment_lights(environment, 8192, radiance_scale=SCALE, radius=radius)
    bound = (1 - (place / radius) ** 2) ** -0.5 - 1
    errors = []
    random = np.random.default_rng(1)
    for where, normal in zip(
        uniform_on_sphere(60, place, random), uniform_on_sphere(60, 1.0, random), strict=True
    ):
        errors.append(irradiance(lights, colours, where, normal)[0] / np.pi - 1)
    # The lights are a quadrature of 8192 points, itself good to a thousandth or so.
    assert max(errors) < bound + 0.004
    assert min(errors) > -0.004
    assert max(errors) > 0.3 * bound


@pytest.mark.parametrize(("sun", "error_at_2"), [(0.0, 0.09), (800.0, 0.19)])
def test_parallax_under_a_sky_errs_as_it_is_said_to(sun: float, error_at_2: float) -> None:
    directions, solid_angle = pixel_directions(128, 256)
    height = directions[..., 2:]
    sky = np.where(height > 0, 0.3 + 0.7 * height, 0.15) * np.array([0.7, 0.85, 1.0])
    sky[directions @ np.array([0.6, 0.0, 0.8]) > np.cos(np.radians(2))] += sun
    normals = uniform_on_sphere(100, 1.0, np.random.default_rng(4))
    exact = np.array([
        (np.maximum(directions @ normal, 0) * solid_angle[:, None]).ravel() @ sky.reshape(-1, 3)
        for normal in normals
    ])  # fmt: skip

    def error(radius: float) -> float:
        lights, colours = environment_lights(sky, 64, radiance_scale=SCALE, radius=radius)
        found = np.array([irradiance(lights, colours, 0.5 * normal, normal) for normal in normals])
        return float(np.abs(found - exact).mean() / exact.mean())

    assert error(2.0) == pytest.approx(error_at_2, abs=0.02)
    assert error(4.0) == pytest.approx(error_at_2 / 2, abs=0.02)
    assert error(1e4) < 0.01


def test_a_small_sun_becomes_lights_in_its_direction_of_its_power() -> None:
    environment = np.zeros((64, 128, 3))
    environment[10:12, 40:43] = [1000.0, 800.0, 500.0]
    directions, solid_angle = pixel_directions(64, 128)
    sun = directions[10:12, 40:43].mean(axis=(0, 1))
    sun /= np.linalg.norm(sun)
    lights, colours = environment_lights(environment, 3, radiance_scale=SCALE)
    assert (lights @ sun > 2 * 0.995).all()
    expected = np.array([1000.0, 800.0, 500.0]) * 3 * solid_angle[10:12].sum()
    np.testing.assert_allclose(irradiance(lights, colours, np.zeros(3), sun), expected, rtol=2e-3)
    # Six bright pixels make no more than six lights.
    assert len(environment_lights(environment, 50, radiance_scale=SCALE)[0]) == 6


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 40), st.sampled_from([None, 0, 7]))
def test_no_power_is_lost_whatever_the_map(seed: int, count: int, drawn: int | None) -> None:
    random = np.random.default_rng(seed)
    environment = np.exp(random.normal(0, 2, (8, 16, 1))) * random.random((8, 16, 1)).round() * [1.0, 1, 1]
    lights, colours = environment_lights(environment, count, radiance_scale=SCALE, seed=drawn)
    assert len(lights) <= count
    power = (environment * pixel_directions(8, 16)[1][:, None, None]).sum(axis=(0, 1))
    # c P / (4 pi) / R^2 is the irradiance head on.
    np.testing.assert_allclose(colours.sum(axis=0) * POWER_W / (4 * np.pi) / 2.0**2, power, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(lights, axis=1), 2.0)


def test_drawn_lights_are_right_in_the_mean_and_repeat_with_the_seed() -> None:
    random = np.random.default_rng(3)
    environment = np.exp(random.normal(0, 1, (16, 32, 1))) * random.uniform(0.5, 1.5, (16, 32, 3))
    directions, solid_angle = pixel_directions(16, 32)
    normal = np.array([0.6, 0.0, 0.8])
    share = np.maximum(directions @ normal, 0) * solid_angle[:, None]
    expected = (environment * share[..., None]).sum(axis=(0, 1))
    found = np.array([
        irradiance(*environment_lights(environment, 24, radiance_scale=SCALE, seed=seed), np.zeros(3), normal)
        for seed in range(400)
    ])  # fmt: skip
    error = found.std(axis=0) / np.sqrt(400)
    assert (np.abs(found.mean(axis=0) - expected) < 4 * error).all()
    assert (error < 0.02 * expected).all()
    again = environment_lights(environment, 24, radiance_scale=SCALE, seed=5)
    for one, other in zip(
        again, environment_lights(environment, 24, radiance_scale=SCALE, seed=5), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_lights_of_an_environment_light_a_visionnet_whatever_its_scale() -> None:
    net, environment = drawn_visionnet(cube()), np.ones((16, 32, 3))
    lights, colours = environment_lights(environment, 16, radiance_scale=net.radiance_scale)
    camera = look_at(np.array([[1.2, -1.5, 1.0]]))
    image = net.render(camera, lights[None], 24, 39.6, 8, light_colour=colours)
    assert np.isfinite(image).all()
    twice = net.render(camera, lights[None], 24, 39.6, 1, light_colour=2 * colours)
    once = net.render(camera, lights[None], 24, 39.6, 1, light_colour=colours)
    np.testing.assert_allclose(twice[..., :3], 2 * once[..., :3], rtol=1e-6)


def test_a_black_environment_has_no_lights() -> None:
    lights, colours = environment_lights(np.zeros((4, 8, 3)), 5, radiance_scale=SCALE)
    assert lights.shape == colours.shape == (0, 3)


def test_what_is_no_environment_is_refused(subtests: pytest.Subtests) -> None:
    for change, word in [
        ({"radiance": np.ones((4, 8))}, "environment: shape"),
        ({"radiance": -np.ones((4, 8, 3))}, "negative"),
        ({"radiance": np.full((4, 8, 3), np.nan)}, "not finite"),
        ({"count": 0}, "at least one"),
        ({"radius": 0.5}, "radius: 0.5"),
    ]:
        with subtests.test(change=change):
            query = {"radiance": np.ones((4, 8, 3)), "count": 4, "radiance_scale": SCALE}
            with pytest.raises(QueryError, match=word):
                environment_lights(**{**query, **change})
