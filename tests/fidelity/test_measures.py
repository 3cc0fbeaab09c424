"""Measures of error against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.fidelity.images import psnr_db, ssim
from objectfolder.fidelity.sight import lit_pixels, measure_within
from objectfolder.fidelity.sounds import (
    cents,
    envelope_distance,
    gain_error_by_mode_db,
    gain_error_by_point_db,
    gain_error_db,
    stft_distance,
)
from objectfolder.products.store import Array, Product


def _image(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(20, 200, (40, 48, 3), dtype=np.uint8)


@pytest.mark.parametrize("offset", [1, 5, 30])
def test_psnr_of_a_constant_offset(offset: int) -> None:
    image = _image(0)
    assert psnr_db(image, image + np.uint8(offset)) == pytest.approx(20 * np.log10(255 / offset))


def test_psnr_sees_only_the_mask_and_is_bounded_by_the_rounding_of_8_bits() -> None:
    image, mask = _image(1), np.zeros((40, 48), dtype=bool)
    mask[:10] = True
    variant = image.copy()
    variant[10:] += 40
    assert psnr_db(image, variant, mask) == pytest.approx(20 * np.log10(255 * np.sqrt(12)))
    assert psnr_db(image, variant) < 20
    assert np.isnan(psnr_db(image, variant, np.zeros_like(mask)))


def test_lit_pixels_are_covered_and_bright_by_their_own_colour() -> None:
    rgba = np.zeros((3, 1, 4, 4), dtype=np.float32)
    # Lit; as bright, but covered by less than half; dark; a dark colour, covered by three quarters.
    rgba[0, 0, :, 3] = 1.0, 0.4, 1.0, 0.75
    rgba[0, 0, :, 1] = 0.02, 0.02, 0.009, 0.0076
    rgba[2] = rgba[0]
    dims = ("view", "y", "x", "channel")
    held_out = Array(np.array([True, True, False]), ("view",), "1", "")
    lit = lit_pixels(Product({"rgba": Array(rgba, dims, "1", ""), "held_out": held_out}))
    np.testing.assert_array_equal(lit[:, 0], [[True, False, False, True], [False] * 4])
    image = np.zeros((2, 1, 4, 3), dtype=np.uint8)
    variant = image + np.array([51, 0, 0, 51], dtype=np.uint8)[:, None]
    assert measure_within(image, lit, variant) == [pytest.approx(20 * np.log10(5))], "no view without any"
    assert len(measure_within(image, lit, variant, 2)) == 1
    assert measure_within(image, lit, variant, 3) == [], "no view of fewer lit pixels than the least"


@given(st.integers(0, 1000), st.integers(0, 1000))
def test_image_measures_are_symmetric(first: int, second: int) -> None:
    assert psnr_db(_image(first), _image(second)) == psnr_db(_image(second), _image(first))
    assert ssim(_image(first), _image(second)) == pytest.approx(ssim(_image(second), _image(first)))


def test_ssim_is_one_for_equal_images_and_falls_with_noise() -> None:
    image = _image(2)
    noisy = np.clip(image + np.random.default_rng(3).normal(0, 20, image.shape), 0, 255).astype(np.uint8)
    assert ssim(image, image) == pytest.approx(1.0)
    assert ssim(image, noisy) < 0.98


def test_cents_of_an_octave_and_of_one_per_cent() -> None:
    assert cents(np.array([880.0]), np.array([440.0]))[0] == pytest.approx(1200)
    assert cents(np.array([101.0]), np.array([100.0]))[0] == pytest.approx(17.226, abs=1e-3)


@pytest.mark.parametrize("share", [0.1, 0.01])
def test_gain_error_of_a_scaled_answer(share: float) -> None:
    truth = np.random.default_rng(4).normal(size=(30, 3, 7))
    assert gain_error_db(truth, truth * (1 + share)) == pytest.approx(20 * np.log10(share))
    np.testing.assert_allclose(gain_error_by_mode_db(truth, truth * (1 + share)), 20 * np.log10(share))


def test_gain_errors_are_one_mode_each() -> None:
    truth = np.random.default_rng(5).normal(size=(30, 3, 2))
    answer = truth.copy()
    answer[:, :, 1] = 0
    errors = gain_error_by_mode_db(truth, answer)
    assert errors[0] < -250
    assert errors[1] == pytest.approx(0.0)


def test_gain_errors_are_of_one_points_own_size_each() -> None:
    truth = np.random.default_rng(6).normal(size=(3, 3, 7)) * np.array([1.0, 100.0, 1.0])[:, None, None]
    answer = truth * (1 + np.array([0.1, 0.001, 0.0])[:, None, None])
    errors = gain_error_by_point_db(truth, answer)
    np.testing.assert_allclose(errors[:2], [-20, -60])
    assert errors[2] < -250


def test_envelope_distance_of_a_sine_with_a_wrong_amplitude() -> None:
    time = np.arange(8000) / 16000
    sine = np.sin(2 * np.pi * 1000 * time)[None]
    assert envelope_distance(sine, 0.9 * sine) == pytest.approx(0.1, rel=0.01)
    assert envelope_distance(sine, sine) == 0.0


def test_envelope_distance_does_not_depend_on_loudness() -> None:
    sine = np.sin(np.arange(8000) * 0.4)[None]
    assert envelope_distance(1e-6 * sine, 0.9e-6 * sine) == pytest.approx(envelope_distance(sine, 0.9 * sine))


def test_stft_distance_scales_with_the_square_of_the_error_and_is_zero_for_equal_sounds() -> None:
    time = np.arange(16000) / 16000
    sine = np.sin(2 * np.pi * 1000 * time)[None]
    assert stft_distance(sine, sine, 16000) == 0.0
    small, large = (stft_distance(sine, (1 - share) * sine, 16000) for share in (0.01, 0.1))
    assert large == pytest.approx(100 * small, rel=1e-6)


def test_silence_is_compared_without_division_by_zero() -> None:
    silence = np.zeros((2, 4000))
    assert stft_distance(silence, silence, 44100) == 0.0
    assert envelope_distance(silence, silence) == 0.0
