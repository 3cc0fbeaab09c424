"""Streams against the offline bank: any block size, contacts at any sample, bounded work and memory."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.audio.synthesis import Voices, driven_bank, mode_bank
from objectfolder.audio.synthesis.voices import MOST_VOICES
from objectfolder.errors import QueryError

RATE = 44100


def modes(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Ringing, over-damped and undamped modes."""
    random = np.random.default_rng(seed)
    omega = 2 * np.pi * random.uniform(60, 19000, count)
    ratio = 10 ** random.uniform(-4, 0.5, count)
    ratio[::7] = 0.0
    return omega**2, ratio * omega


def blocks_of(voices: Voices, sizes: list[int], samples: int, events: list[tuple]) -> np.ndarray:
    """Take blocks of the sizes in turn; each contact is announced in the block it begins in."""
    pieces, index = [], 0
    while voices.now < samples:
        size = min(sizes[index % len(sizes)], samples - voices.now)
        for at, amplitudes, pulse in events:
            if voices.now <= at < voices.now + size:
                voices.strike(amplitudes, at=at, pulse_s=pulse)
        pieces.append(voices.block(size))
        index += 1
    return np.concatenate(pieces)


@given(st.lists(st.integers(1, 1500), min_size=1, max_size=4), st.integers(0, 100))
def test_blocks_of_any_size_are_the_offline_sound_to_1e_10(sizes: list[int], seed: int) -> None:
    samples = 6000
    random = np.random.default_rng(seed)
    eigenvalues, dampings = modes(10, seed)
    amplitudes = random.normal(size=(4, 10))
    events = [
        (at, a, pulse)
        for at, a, pulse in zip((0, 130.25, 131, 4000.5), amplitudes, (None, 3e-4, None, 0.011), strict=True)
    ]
    streamed = blocks_of(Voices.of_modes(eigenvalues, dampings, RATE), sizes, samples, events)
    offline = sum(
        mode_bank(
            eigenvalues,
            dampings,
            a,
            duration_s=samples / RATE,
            sample_rate_hz=RATE,
            pulse_s=pulse,
            delay_s=at / RATE,
        )[0]
        for at, a, pulse in events
    )
    np.testing.assert_allclose(streamed, offline, atol=1e-10 * np.abs(amplitudes).sum(), rtol=0)


def test_seconds_of_blocks_keep_the_phase_of_undamped_modes() -> None:
    eigenvalues = (2 * np.pi * np.array([440.0, 7001.3, 19500.0])) ** 2
    voices = Voices.of_modes(eigenvalues, np.zeros(3), RATE)
    voices.strike(np.ones(3))
    streamed = np.concatenate([voices.block(128) for _ in range(4000)])
    offline = mode_bank(
        eigenvalues, np.zeros(3), np.ones(3), duration_s=4000 * 128 / RATE, sample_rate_hz=RATE
    )[0]
    np.testing.assert_allclose(streamed, offline, atol=1e-9, rtol=0)


def test_a_contact_begins_at_its_sample_within_a_block() -> None:
    eigenvalues, dampings = modes(5, 1)
    voices = Voices.of_modes(eigenvalues, dampings, RATE)
    voices.block(64)
    voices.strike(np.ones(5), at=64 + 37)
    block = voices.block(64)
    assert not block[:37].any()
    assert block[37] == pytest.approx(5.0)


def test_sampled_forces_stream_as_they_sound_offline() -> None:
    eigenvalues, dampings = modes(8, 2)
    random = np.random.default_rng(5)
    gains, force = random.normal(size=(3, 8)), random.normal(size=(777, 3))
    voices = Voices.of_modes(eigenvalues, dampings, RATE)
    voices.push(gains, force, at=55)
    streamed = np.concatenate([voices.block(90) for _ in range(40)])
    offline = driven_bank(
        eigenvalues, dampings, gains, force, duration_s=3600 / RATE, sample_rate_hz=RATE, delay_samples=55
    )[0]
    np.testing.assert_allclose(streamed, offline, atol=1e-10 * np.abs(offline).max(), rtol=0)


def test_output_weights_and_response_are_those_of_the_bank() -> None:
    eigenvalues, dampings = modes(6, 3)
    weights, amplitudes = np.arange(1.0, 7.0), np.ones(6)
    voices = Voices.of_modes(eigenvalues, dampings, RATE, response="displacement", output_weights=weights)
    voices.strike(amplitudes, pulse_s=1e-3)
    offline = mode_bank(
        eigenvalues,
        dampings,
        weights * amplitudes,
        duration_s=0.02,
        sample_rate_hz=RATE,
        response="displacement",
        pulse_s=1e-3,
    )[0]
    np.testing.assert_allclose(voices.block(882), offline, atol=1e-10 * np.abs(offline).max(), rtol=0)


def test_voices_retire_when_they_are_inaudible() -> None:
    eigenvalues, dampings = (
        (2 * np.pi * np.array([500.0, 3000.0, 9000.0])) ** 2,
        np.array([30.0, 100.0, 900.0]),
    )
    voices = Voices.of_modes(eigenvalues, dampings, RATE, floor_db=-100.0)
    assert voices.silent
    voices.strike(np.ones(3))
    assert voices.waiting == 1
    living = []
    for _ in range(200):
        voices.block(128)
        living.append(voices.ringing_modes)
    assert voices.waiting == 0
    assert set(living) == {3, 2, 1, 0}
    assert living == sorted(living, reverse=True)
    assert voices.silent
    assert not voices.block(128).any()
    voices.strike(np.ones(3))
    assert voices.block(128)[0] == pytest.approx(3.0)


def test_memory_and_work_do_not_grow_with_contacts() -> None:
    eigenvalues, dampings = modes(32, 4)
    voices = Voices.of_modes(eigenvalues, dampings, RATE)
    random = np.random.default_rng(6)

    def play(contacts: int) -> None:
        for _ in range(contacts):
            voices.strike(random.normal(size=32), at=voices.now + random.uniform(0, 64), pulse_s=2e-4)
            voices.block(64)

    play(20)
    tracemalloc.start()
    try:
        play(20)
        settled = tracemalloc.get_traced_memory()[0]
        play(400)
        assert tracemalloc.get_traced_memory()[0] < settled + 100_000
    finally:
        tracemalloc.stop()
    assert voices.waiting <= 10


def test_waiting_contacts_are_bounded() -> None:
    voices = Voices.of_modes([1e7], [1.0], RATE)
    for _ in range(MOST_VOICES):
        voices.strike([1.0], at=1e6)
    with pytest.raises(QueryError, match="contacts wait"):
        voices.strike([1.0])
    second = Voices.of_modes([1e7], [1.0], RATE)
    with pytest.raises(QueryError, match="contacts wait"):
        second.strike([1.0], pulse_s=1000.0)


def test_no_mode_is_silence_and_zero_force_is_zeros() -> None:
    empty = Voices.of_modes([], [], RATE)
    empty.strike([])
    assert not empty.block(100).any()
    voices = Voices.of_modes([1e7, 1e9], [1.0, 1e5], RATE)
    voices.strike([0.0, 0.0], pulse_s=1e-3)
    assert not voices.block(1000).any()


def test_impossible_contacts_are_refused(subtests: pytest.Subtests) -> None:
    for amplitudes, options in [
        ([np.nan], {}),
        ([1.0, 2.0], {}),
        ([1.0], {"at": -1}),
        ([1.0], {"at": np.nan}),
        ([1.0], {"pulse_s": 0.0}),
        ([1.0], {"pulse_s": np.nan}),
        ([1.0], {"pulse_s": np.inf}),
    ]:
        with subtests.test(amplitudes=amplitudes):
            voices = Voices.of_modes([1e7], [1.0], RATE)
            with pytest.raises(QueryError):
                voices.strike(amplitudes, **options)
            assert voices.waiting == 0


def test_a_sample_that_has_passed_and_an_empty_block_are_refused() -> None:
    voices = Voices.of_modes([1e7], [1.0], RATE)
    voices.block(10)
    with pytest.raises(QueryError, match="at"):
        voices.strike([1.0], at=9)
    with pytest.raises(QueryError, match="samples"):
        voices.block(0)
    with pytest.raises(QueryError, match="begin on a sample"):
        voices.push([[1.0]], [[1.0]], at=10.5)
    with pytest.raises(QueryError, match="shapes"):
        voices.push([[1.0]], [1.0])
