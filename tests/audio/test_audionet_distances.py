"""The papers' STFT distance, against the sum written out."""

import numpy as np
import pytest

from objectfolder.fidelity.sounds import stft_distance, unscaled_stft_distance


def written_out(difference: np.ndarray) -> float:
    """Mean square of real and imaginary parts: 512 bins, Hann window of 400, hop 160, frames centred."""
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(400) / 400)
    padded = np.pad(difference, 200)
    frames = np.stack([padded[s : s + 400] * window for s in range(0, len(padded) - 399, 160)])
    transform = np.fft.rfft(frames, 512, axis=1)
    return float(np.mean([np.mean(transform.real**2), np.mean(transform.imag**2)]))


def test_unscaled_stft_distance_is_the_sum_written_out() -> None:
    random = np.random.default_rng(0)
    truth, answer = random.normal(size=(2, 3, 16000))
    peak = np.abs(truth).max(axis=1)
    expected = np.mean([written_out((y - x) / top) for x, y, top in zip(truth, answer, peak, strict=True)])
    assert unscaled_stft_distance(truth, answer) == pytest.approx(expected, rel=0.01)


def test_the_two_scalings_differ_by_the_window_alone() -> None:
    random = np.random.default_rng(1)
    truth, answer = random.normal(size=(2, 2, 4000))
    ratio = unscaled_stft_distance(truth, answer) / stft_distance(truth, answer, 44100.0)
    assert ratio == pytest.approx((0.5 * 400) ** 2 / 2)
