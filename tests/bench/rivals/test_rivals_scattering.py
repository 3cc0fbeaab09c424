import dataclasses

import numpy as np
import pytest
import torch

from bench.rivals.vision.scattering_function import ScatteringFunction
from bench.rivals.vision.scattering_network import ScatteringNetwork, encode
from bench.rivals.vision.scattering_training import TrainingPixels, fit_scattering_function
from objectfolder.errors import InputError
from objectfolder.products.store import Array, Product
from objectfolder.vision.cameras import look_at, pixel_rays, uniform_on_sphere
from objectfolder.vision.compositing import composite_on_white, srgb_decode

pytestmark = pytest.mark.release("bench.rivals")


@pytest.fixture(autouse=True)
def _one_thread():
    """Small products wait longer for a second thread than they take."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


COLOUR = (0.25, 0.5, 0.75)  # sRGB-encoded


class Ball(ScatteringNetwork):
    """A uniform ball of radius 1/2 in place of a network."""

    def __init__(self, extinction: float) -> None:
        super().__init__()
        self.extinction = extinction

    def forward(self, positions, views, lights):
        """The ball's density and a colour that does not depend on anything."""
        inside = positions.norm(dim=-1) < 0.5
        return inside * self.extinction - 1e-3, torch.tensor(COLOUR).expand(*positions.shape[:2], 3)


def ball(extinction: float) -> ScatteringFunction:
    return ScatteringFunction(Ball(extinction), Ball(extinction), 2.5)


def image(
    fitted: ScatteringFunction, view: np.ndarray, light: np.ndarray, size: tuple[int, int]
) -> np.ndarray:
    """All pixels of a view."""
    pixels = fitted.pixels(view, light, np.arange(size[0] * size[1]), size, 39.6)
    assert pixels.dtype == np.float32
    return pixels.reshape(*size, 4)


def coloured_views(count: int = 3, held_out: int = 1, size: tuple[int, int] = (6, 8)) -> Product:
    """Views that the object fills, each pixel of its own colour and the held-out ones white."""
    generator = np.random.default_rng(0)
    rgba = np.ones((count, *size, 4), dtype=np.float16)
    rgba[: count - held_out, ..., :3] = generator.random((count - held_out, *size, 3))
    mask = np.arange(count) >= count - held_out
    poses = look_at(uniform_on_sphere(count, 2.5, generator))
    lights = uniform_on_sphere(count, 1.0, generator)
    arrays = {
        "rgba": Array(rgba, ("view", "y", "x", "channel"), "1", "radiance"),
        "camera_to_world": Array(poses, ("view", "row", "column"), "1", "pose"),
        "light_position": Array(lights, ("view", "axis"), "1", "light"),
        "held_out": Array(mask, ("view",), "1", "held out"),
    }
    return Product(arrays, {"field_of_view_deg": 39.6, "camera_radius": 2.5})


def test_the_networks_have_the_published_shape():
    layers = [63, 256, 256, 256, 256, 256 + 63, 256, 256]
    count = (
        sum(entering * 256 + 256 for entering in layers) + 257 + 256 * 257 + 128 * (256 + 54 + 1) + 3 * 129
    )
    coarse, fine = ScatteringNetwork(), ScatteringNetwork()
    assert ScatteringFunction(coarse, fine, 2.5).parameters == 2 * count
    assert [layer.in_features for layer in coarse.hidden] == layers


def test_positions_carry_ten_octaves_and_directions_four():
    value = torch.tensor([[0.3, -0.2, 0.1]], dtype=torch.float64)
    encoding = encode(value, 10)
    assert encoding.shape == (1, 63)
    assert encode(value, 4).shape == (1, 27)
    np.testing.assert_allclose(encoding[0, -6:-3], np.sin(512 * value[0]), atol=1e-12)
    np.testing.assert_allclose(encoding[0, -3:], np.cos(512 * value[0]), atol=1e-12)


def test_an_opaque_ball_has_its_disc_and_its_colour():
    (view,) = look_at(np.array([[0.0, -2.5, 0.0]]))
    shown = image(ball(1e4), view, np.array([0.0, -1.0, 0.0]), (36, 48))
    # A ball is seen as a circle of half angle asin(r / d).
    focal = 24 / np.tan(np.radians(19.8))
    row, column = np.mgrid[:36, :48] + 0.5
    distance = np.hypot(row - 18, column - 24)
    radius = focal * np.tan(np.arcsin(0.5 / 2.5))
    assert shown[distance < radius - 0.6, 3].min() > 0.999
    assert shown[distance > radius + 0.6, 3].max() < 0.01
    assert np.abs(composite_on_white(shown[18, 24]) - COLOUR).max() < 1e-4
    np.testing.assert_allclose(shown[18, 24, :3], srgb_decode(np.array(COLOUR)), atol=1e-4)


def test_a_thin_ball_is_as_opaque_as_its_chord_is_long():
    # At the densities of fog the samples, not the law, limit accuracy: 192 along 4.
    (view,) = look_at(np.array([[2.5, 0.0, 0.0]]))
    (middle,) = ball(1.5).pixels(view, np.array([1.0, 0.0, 0.0]), np.array([16 * 33 + 16]), 33, 39.6)
    np.testing.assert_allclose(middle[3], 1 - np.exp(-1.5), atol=0.02)
    expected = middle[3] * np.array(COLOUR) + 1 - middle[3]
    np.testing.assert_allclose(composite_on_white(middle), expected, atol=1e-5)


def test_pixels_alone_are_those_of_the_image():
    fitted = ScatteringFunction(ScatteringNetwork(), ScatteringNetwork(), 2.5)
    (view,) = look_at(np.array([[1.0, 1.0, 2.0]]))
    light = np.array([1.0, 0.0, 0.0])
    some = fitted.pixels(view, light, np.array([5, 17]), (4, 6), 39.6)
    np.testing.assert_allclose(some, image(fitted, view, light, (4, 6)).reshape(-1, 4)[[5, 17]], atol=1e-5)


def test_pixels_drawn_are_those_of_training_views_with_their_rays_and_lights():
    views = coloured_views(4, 1)
    pixels = TrainingPixels(views)
    origins, directions, lights, colours = (
        part.numpy() for part in pixels.draw(400, np.random.default_rng(1), torch.device("cpu"))
    )
    indices = set()
    for index in range(3):
        camera = views["camera_to_world"][index]
        expected = pixel_rays(camera, np.arange(48), np.array([[0.5, 0.5]]), (6, 8), 39.6)[1]
        own = np.flatnonzero(np.abs(origins - camera[:3, 3]).max(axis=1) < 1e-5)
        which = np.abs(directions[own, None] - expected[None]).max(axis=-1)
        assert which.min(axis=1).max() < 1e-6
        shown = composite_on_white(views["rgba"][index].astype(np.float32)).reshape(-1, 3)
        np.testing.assert_allclose(colours[own], shown[which.argmin(axis=1)], atol=0.51 / 255)
        np.testing.assert_allclose(
            lights[own], np.tile(views["light_position"][index], (len(own), 1)), atol=1e-6
        )
        indices |= set(own)
    assert len(indices) == 400


def test_a_fit_learns_and_is_repeated_by_its_seed():
    views = coloured_views()
    rgba = views["rgba"].copy()
    rgba[..., :3] = 0.01
    dark = Product(
        {**views.arrays, "rgba": dataclasses.replace(views.arrays["rgba"], data=rgba)}, views.attributes
    )
    fitted, again = (fit_scattering_function(dark, steps=14, batch_rays=8, seed=5) for _ in range(2))
    assert fitted.training.losses[-1] < 0.7 * fitted.training.losses[0]
    np.testing.assert_array_equal(again.training.losses, fitted.training.losses)
    for first, second in zip(fitted.fine.parameters(), again.fine.parameters(), strict=True):
        torch.testing.assert_close(first, second, rtol=0, atol=0)
    another = fit_scattering_function(dark, steps=14, batch_rays=8, seed=6)
    assert not np.array_equal(another.training.losses, fitted.training.losses)


def test_a_budget_ends_a_fit():
    fitted = fit_scattering_function(coloured_views(), budget_cpu_s=0.2, batch_rays=2, seed=0)
    assert 1 <= fitted.training.steps < 200
    assert fitted.training.cpu_s >= 0.2


@pytest.mark.parametrize("end", [{}, {"steps": -1}, {"budget_cpu_s": -1.0}])
def test_a_fit_must_have_an_end(end):
    with pytest.raises(InputError, match="not negative"):
        fit_scattering_function(coloured_views(), **end)


def test_views_that_are_all_held_out_cannot_be_fitted():
    with pytest.raises(InputError, match="held out"):
        fit_scattering_function(coloured_views(2, 2), steps=1)
