"""The papers' networks for touch: as published, learning, repeatable; the renderer of a deformed gel."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from touch_shapes import bumpy, psnr_db

from bench.rivals.published import OCTAVES, Perceptrons, encode
from bench.rivals.touch.networks import FIRST, RIVALS, SECOND, fit_touch_network, render_deformation
from objectfolder.errors import InputError
from objectfolder.making.touches.record import simulate_touches
from objectfolder.products.store import Product
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.sensor import Sensor

pytestmark = pytest.mark.release("bench.rivals")
SENSOR = Sensor(image_height=32, image_width=24)


@pytest.fixture(scope="module")
def touches() -> Product:
    return simulate_touches(bumpy(), SENSOR, touches=4, held_out_touches=2, samples=1, seed=3)


def training(touches: Product, name: str) -> np.ndarray:
    return np.asarray(touches[name])[~touches["held_out"]]


def asked(touches: Product) -> list[np.ndarray]:
    return [training(touches, name) for name in ("points", "depth_m", "tilt_deg", "azimuth_deg")]


def test_the_networks_have_the_published_sizes() -> None:
    # 8 x 256, the input again at the sixth layer: counted from the published layers by hand.
    for dimensions, outputs in ((5, 3), (9, 1)):
        inputs = dimensions * 21
        by_hand = (inputs + 1) * 256 + 6 * 257 * 256 + (256 + inputs + 1) * 256 + 257 * outputs
        assert Perceptrons(dimensions, np.zeros((1, outputs))).weights == by_hand
    assert 2.0e6 < 4 * Perceptrons(5, np.zeros((1, 3))).weights < 2.1e6


def test_coordinates_are_encoded_by_octaves() -> None:
    values = torch.tensor([[0.3, -0.7]])
    encoded = encode(values).numpy()[0]
    expected = [values.numpy()[0]]
    for octave in range(OCTAVES):
        expected += [np.sin(values.numpy()[0] * 2**octave), np.cos(values.numpy()[0] * 2**octave)]
    assert np.allclose(encoded, np.concatenate(expected), atol=1e-4)


def test_image_network_learns_the_touches_it_is_shown(touches: Product) -> None:
    fitted = fit_touch_network(FIRST, touches, steps=150, batch_pixels=128)
    losses = fitted.training.losses
    assert losses[-10:].mean() < 0.5 * losses[:5].mean()
    truth = training(touches, "rgb")
    answer = fitted.render(training(touches, "points"))
    mean = np.broadcast_to(np.rint(truth.mean(axis=0)).astype(np.uint8), truth.shape)
    assert psnr_db(truth, answer) > psnr_db(truth, mean) + 1


def test_deformation_network_learns_the_touches_it_is_shown(touches: Product) -> None:
    fitted = fit_touch_network(SECOND, touches, steps=60, batch_pixels=128)
    losses = fitted.training.losses
    assert losses[-10:].mean() < 0.5 * losses[:5].mean()
    truth = training(touches, "depth").astype(np.float64)
    answer = fitted.deformation(*asked(touches))
    mean = truth.mean(axis=0)
    assert np.square(answer - truth).mean() < 0.5 * np.square(mean - truth).mean()
    images = fitted.render(*asked(touches))
    untouched = np.broadcast_to(no_contact_image(SENSOR, 1), images.shape)
    assert psnr_db(training(touches, "rgb"), images) > psnr_db(training(touches, "rgb"), untouched)


@pytest.mark.parametrize("name", RIVALS)
def test_a_seed_gives_the_same_network_and_batches_do_not_matter(touches: Product, name: str) -> None:
    def fitted(seed: int) -> Any:
        torch.manual_seed(np.random.default_rng().integers(2**31))  # nothing outside has a say
        return fit_touch_network(name, touches, steps=3, batch_pixels=64, seed=seed)

    once, again, variant = fitted(0), fitted(0), fitted(1)
    points, depth, tilt, azimuth = asked(touches)
    both = once.render(points, depth, tilt, azimuth)
    assert np.array_equal(both, again.render(points, depth, tilt, azimuth))
    assert not np.array_equal(once.training.losses, variant.training.losses)
    for index in range(len(points)):
        part = slice(index, index + 1)
        alone = once.render(points[part], depth[part], tilt[part], azimuth[part])
        # Torch may round a row of a matrix product by its place among others: a grey level at most.
        np.testing.assert_allclose(alone[0].astype(float), both[index].astype(float), atol=1.0)


def test_only_the_second_network_knows_how_the_sensor_is_held(touches: Product) -> None:
    points = training(touches, "points")[:1]
    first = fit_touch_network(FIRST, touches, steps=5, batch_pixels=64)
    second = fit_touch_network(SECOND, touches, steps=5, batch_pixels=64)
    assert np.array_equal(first.render(points, 0.0005), first.render(points, 0.002, 15.0, 90.0))
    assert not np.array_equal(second.deformation(points, 0.0005), second.deformation(points, 0.002))
    assert not np.array_equal(
        second.deformation(points, 0.001, 15.0, 0.0), second.deformation(points, 0.001, 15.0, 90.0)
    )


def test_a_budget_of_no_seconds_leaves_the_mean(touches: Product) -> None:
    fitted = fit_touch_network(FIRST, touches, budget_cpu_s=0.0)
    assert fitted.training.steps == 0
    colour = np.rint(training(touches, "rgb").mean(axis=(0, 1, 2)))
    assert np.abs(fitted.render(training(touches, "points")[:1]) - colour).max() <= 1


def test_a_deformed_gel_is_drawn_as_the_press_that_deformed_it(touches: Product) -> None:
    fine = Sensor()
    pressed = simulate_touches(bumpy(amplitude=0.0), fine, touches=3, held_out_touches=0, samples=1, seed=1)
    untouched = no_contact_image(fine, 1)
    for rgb, depth, mask in zip(pressed["rgb"], pressed["depth"], pressed["mask"], strict=True):
        answer = render_deformation(fine, depth)
        inner = mask & np.roll(mask, 2, 0) & np.roll(mask, -2, 0) & np.roll(mask, 2, 1) & np.roll(mask, -2, 1)
        assert inner.sum() > 100
        # A smooth ball: away from the outline, differences between pixels are normals.
        assert psnr_db(rgb, answer, inner) > 38
        assert psnr_db(rgb, untouched, inner) < 30
    assert np.abs(render_deformation(fine, np.zeros((160, 120))).astype(int) - untouched).max() <= 1


def test_a_gel_pushed_in_evenly_is_a_gel_that_stands_nearer() -> None:
    sensor, push = Sensor(), 0.008
    x, y, z = sensor.gel_apex_m
    nearer = no_contact_image(replace(sensor, gel_apex_m=(x - push, y, z)), 1).astype(int)
    image = render_deformation(sensor, np.full((160, 120), push)).astype(int)
    assert np.abs(image - nearer)[1:-1, 1:-1].max() <= 1
    assert np.abs(nearer - no_contact_image(sensor, 1)).max() > 10


@pytest.mark.parametrize("options", [{}, {"steps": -1}, {"budget_cpu_s": -1.0}])
def test_a_fit_needs_a_length(touches: Product, options: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="not negative"):
        fit_touch_network("ObjectFolder 1.0", touches, **options)


def test_what_cannot_be_fitted_or_asked_is_refused(touches: Product) -> None:
    with pytest.raises(InputError, match="unknown name"):
        fit_touch_network("ObjectFolder 3.0", touches, steps=1)
    none = simulate_touches(bumpy(), SENSOR, touches=0, held_out_touches=1, samples=1)
    with pytest.raises(InputError, match="held out"):
        fit_touch_network("ObjectFolder 2.0", none, steps=1)
    for fitted in (fit_touch_network(FIRST, touches, steps=0), fit_touch_network(SECOND, touches, steps=0)):
        with pytest.raises(InputError, match="finite"):
            fitted.render(np.full((1, 3), np.nan))
        assert fitted.render(np.zeros((0, 3))).shape == (0, 32, 24, 3)
