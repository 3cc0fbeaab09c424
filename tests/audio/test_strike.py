"""The mode bank against its formula, and its invariants."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from objectfolder.audio.strike import strike
from objectfolder.errors import QueryError

MODES = st.integers(1, 12)


def modes(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    return random.uniform(50, 21000, count), random.uniform(0, 500, count), random.normal(size=(3, count))


@settings(max_examples=30, deadline=None)
@given(MODES, st.integers(0, 1000), st.floats(0.001, 0.2))
def test_it_is_the_sum_of_decaying_sines(count: int, seed: int, duration: float) -> None:
    frequencies, dampings, amplitudes = modes(count, seed)
    sound = strike(frequencies, dampings, amplitudes, duration, 44100)
    t = np.arange(round(duration * 44100)) / 44100
    bank = np.exp(-dampings[:, None] * t) * np.sin(2 * np.pi * frequencies[:, None] * t)
    bank[frequencies > 0.45 * 44100] = 0
    assert sound.shape == (3, len(t))
    assert sound.dtype == np.float32
    np.testing.assert_allclose(sound, amplitudes @ bank, atol=2e-6)


@settings(max_examples=30, deadline=None)
@given(MODES, st.integers(0, 1000), st.floats(-100, 100), st.floats(-100, 100))
def test_it_is_linear_in_the_amplitudes(count: int, seed: int, a: float, b: float) -> None:
    frequencies, dampings, amplitudes = modes(count, seed)
    mixed = strike(frequencies, dampings, a * amplitudes[0] + b * amplitudes[1], 0.05, 44100)
    apart = strike(frequencies, dampings, amplitudes, 0.05, 44100)
    np.testing.assert_allclose(
        mixed[0], a * apart[0] + b * apart[1], atol=3e-6 * (1 + abs(a) + abs(b)) * count
    )


@settings(max_examples=20, deadline=None)
@given(MODES, st.integers(0, 1000))
def test_a_batch_answers_as_single_strikes_do(count: int, seed: int) -> None:
    frequencies, dampings, amplitudes = modes(count, seed)
    together = strike(frequencies, dampings, amplitudes, 0.03, 16000)
    for index, amplitude in enumerate(amplitudes):
        np.testing.assert_array_equal(
            strike(frequencies, dampings, amplitude, 0.03, 16000)[0], together[index]
        )


def test_no_force_and_no_mode_are_silence() -> None:
    assert not strike([440.0], [1.0], [[0.0]], 0.1, 44100).any()
    silent = strike([], [], np.zeros((2, 0)), 0.1, 44100)
    assert silent.shape == (2, 4410)
    assert not silent.any()


def test_what_would_alias_is_left_out() -> None:
    assert not strike([23000.0], [0.0], [[1.0]], 0.1, 44100).any()
    assert not strike([7300.0], [0.0], [[1.0]], 0.1, 16000).any()
    assert strike([7100.0], [0.0], [[1.0]], 0.1, 16000).any()


def test_phase_is_kept_for_seconds() -> None:
    t = np.arange(3 * 44100) / 44100
    sound = strike([19000.0], [0.0], [[1.0]], 3, 44100)[0]
    np.testing.assert_allclose(sound, np.sin(2 * np.pi * 19000.0 * t), atol=1e-6)


@pytest.mark.parametrize(
    ("frequencies", "dampings", "amplitudes", "duration", "rate"),
    [
        ([440.0, 441.0], [1.0], [[1.0]], 1, 44100),
        ([440.0], [1.0], [[1.0, 2.0]], 1, 44100),
        ([-1.0], [1.0], [[1.0]], 1, 44100),
        ([np.nan], [1.0], [[1.0]], 1, 44100),
        ([440.0], [-1.0], [[1.0]], 1, 44100),
        ([440.0], [1.0], [[np.inf]], 1, 44100),
        ([440.0], [1.0], [[1.0]], 0, 44100),
        ([440.0], [1.0], [[1.0]], 1, np.nan),
    ],
)
def test_impossible_modes_are_refused(
    frequencies: list, dampings: list, amplitudes: list, duration: float, rate: float
) -> None:
    with pytest.raises(QueryError):
        strike(frequencies, dampings, amplitudes, duration, rate)
