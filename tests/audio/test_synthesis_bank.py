"""The mode bank against its closed form in extended precision, its invariants, and its hard cases."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rounding import assert_equal_but_for_rounding

from objectfolder.audio.synthesis import mode_bank
from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.errors import QueryError
from tests.audio.closed_form import sound_at

RATE = 44100
MODES = st.integers(1, 12)


def modes(count: int, seed: int, highest_hz: float = 21000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    eigenvalues = (2 * np.pi * random.uniform(50, highest_hz, count)) ** 2
    return eigenvalues, random.uniform(0, 300, count), random.normal(size=(3, count))


def ceramic(count: int, highest_hz: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and the Rayleigh damping of ceramic."""
    random = np.random.default_rng(seed)
    eigenvalues = (2 * np.pi * np.sort(random.uniform(60, highest_hz, count))) ** 2
    return eigenvalues, (6 + 1e-7 * eigenvalues) / 2


@given(MODES, st.integers(0, 1000), st.floats(0.001, 0.2))
def test_it_is_the_sum_of_the_velocities_of_modes(count: int, seed: int, duration: float) -> None:
    eigenvalues, dampings, amplitudes = modes(count, seed)
    sound = mode_bank(eigenvalues, dampings, amplitudes, duration_s=duration, sample_rate_hz=RATE)
    t = np.arange(round(duration * RATE)) / RATE
    root = np.sqrt(eigenvalues - dampings**2)[:, None]
    c = dampings[:, None]
    terms = np.exp(-c * t) * (np.cos(root * t) - c / root * np.sin(root * t))
    terms[root[:, 0] > 0.454 * RATE * 2 * np.pi] = 0
    assert sound.shape == (3, len(t))
    assert sound.dtype == np.float64
    np.testing.assert_allclose(sound, amplitudes @ terms, atol=1e-10 * np.abs(amplitudes).sum())


@pytest.mark.parametrize("rate", [44100, 48000])
@pytest.mark.parametrize("damped", [True, False])
def test_the_error_stays_below_1e_10_for_seconds(rate: int, damped: bool) -> None:
    eigenvalues, dampings = ceramic(64, 20000 if rate == 48000 else 19800)
    dampings = dampings * damped
    amplitudes = np.random.default_rng(1).normal(size=64)
    sound = mode_bank(eigenvalues, dampings, amplitudes, duration_s=8.0, sample_rate_hz=rate)[0]
    peak = np.abs(sound).max()
    for sample in (0, 1, 63, 591, 1776, 4099, 44100, 123457, 8 * rate - 1):
        truth = sound_at(eigenvalues, dampings, amplitudes, sample, rate)
        assert abs(sound[sample] - truth) <= 1e-10 * peak


def test_phase_is_kept_for_an_hour_at_20_khz() -> None:
    """4.5e8 radians, each of three roundings 2^-53 of them."""
    samples = 3600 * 48000
    eigenvalue = np.array([(2 * np.pi * 20000.0) ** 2])
    oscillators = Oscillators.checked(eigenvalue, [0.0], 48000)
    late = np.array([samples - 2, samples - 1, samples])
    velocities = oscillators.propagator(late)[:, 1, 1, 0]
    for value, sample in zip(velocities, late, strict=True):
        assert abs(value - sound_at(eigenvalue, np.zeros(1), np.ones(1), sample, 48000)) < 2e-7


def test_critically_damped_and_over_damped_modes(subtests: pytest.Subtests) -> None:
    for ratio, reach in [
        (1.0, 1e-10),  # critical, c^2 = lambda
        (1 - 1e-15, 1e-10),
        (1 + 1e-15, 1e-10),
        (1 + 1e-9, 1e-10),
        (1 - 1e-9, 1e-10),
        (1.05, 1e-10),
        (1.1547, 1e-10),
        (1.1548, 1e-10),
        (3.0, 1e-10),
        (1e4, 1e-10),
    ]:
        with subtests.test(ratio=ratio):
            omega = 2 * np.pi * 500.0
            eigenvalues, dampings = np.array([omega**2]), np.array([ratio * omega])
            sound = mode_bank(eigenvalues, dampings, [1.0], duration_s=0.02, sample_rate_hz=RATE)[0]
            assert np.isfinite(sound).all()
            for sample in (0, 1, 2, 17, 200, 881):
                truth = sound_at(eigenvalues, dampings, np.ones(1), sample, RATE)
                assert abs(sound[sample] - truth) <= reach * max(abs(truth), 1e-6)


def test_far_over_damped_modes_lose_nothing_to_cancellation() -> None:
    """c = 1000 omega: what is left after a millisecond is 1e-7 of the start and right to 12 digits."""
    eigenvalues, dampings = np.array([1e6]), np.array([1e6])
    sound = mode_bank(eigenvalues, dampings, [1.0], duration_s=0.01, sample_rate_hz=RATE)[0]
    truth = sound_at(eigenvalues, dampings, np.ones(1), 44, RATE)
    assert abs(truth) < 1e-6
    assert abs(sound[44] / truth - 1) < 1e-12


def test_displacement_velocity_and_acceleration_are_derivatives_of_one_another() -> None:
    eigenvalues = np.array([(2 * np.pi * 300) ** 2, 900.0**2, 1e5])
    dampings = np.array([40.0, 900.0, 5e3])
    rate = 4e6
    motion = {
        response: mode_bank(
            eigenvalues, dampings, [1.0, -0.4, 0.3], duration_s=2e-3, sample_rate_hz=rate, response=response
        )[0]
        for response in ("displacement", "velocity", "acceleration")
    }
    for lower, upper in (("displacement", "velocity"), ("velocity", "acceleration")):
        slope = (motion[lower][2:] - motion[lower][:-2]) * rate / 2
        np.testing.assert_allclose(slope, motion[upper][1:-1], atol=5e-6 * np.abs(motion[upper]).max())


@given(MODES, st.integers(0, 1000), st.floats(-100, 100), st.floats(-100, 100))
def test_it_is_linear_in_the_force_to_1e_12(count: int, seed: int, a: float, b: float) -> None:
    eigenvalues, dampings, amplitudes = modes(count, seed)
    mixed = mode_bank(
        eigenvalues,
        dampings,
        a * amplitudes[0] + b * amplitudes[1],
        duration_s=0.05,
        sample_rate_hz=RATE,
        pulse_s=3e-4,
    )
    apart = mode_bank(eigenvalues, dampings, amplitudes, duration_s=0.05, sample_rate_hz=RATE, pulse_s=3e-4)
    size = np.abs(a * amplitudes[0]).sum() + np.abs(b * amplitudes[1]).sum()
    # Numbers below the smallest normal one have fewer digits.
    atol = max(1e-12 * size, np.finfo(float).tiny)
    np.testing.assert_allclose(mixed[0], a * apart[0] + b * apart[1], atol=atol, rtol=0)


@given(MODES, st.integers(0, 1000), st.sampled_from([None, 1e-4, (1e-4, 2e-3, 1e-4)]), st.integers(1, 900))
def test_a_contact_sounds_alone_as_in_a_batch(
    count: int, seed: int, pulse: float | tuple[float, ...] | None, samples: int
) -> None:
    eigenvalues, dampings, amplitudes = modes(count, seed, 7000)
    together = mode_bank(
        eigenvalues, dampings, amplitudes, duration_s=samples / 16000, sample_rate_hz=16000, pulse_s=pulse
    )
    for index, amplitude in enumerate(amplitudes):
        own = pulse[index] if isinstance(pulse, tuple) else pulse
        alone = mode_bank(
            eigenvalues, dampings, amplitude, duration_s=samples / 16000, sample_rate_hz=16000, pulse_s=own
        )
        assert_equal_but_for_rounding(alone[0], together[index])


def test_no_force_and_no_mode_are_silence() -> None:
    for pulse in (None, 1e-3):
        assert not mode_bank(
            [1e7, 1e8], [1.0, 2e4], [[0.0, 0.0]], duration_s=0.1, sample_rate_hz=RATE, pulse_s=pulse
        ).any()
        silent = mode_bank([], [], np.zeros((2, 0)), duration_s=0.1, sample_rate_hz=RATE, pulse_s=pulse)
        assert silent.shape == (2, 4410)
        assert not silent.any()
    assert mode_bank([1e7], [1.0], np.zeros((0, 1)), duration_s=0.1, sample_rate_hz=RATE).shape == (0, 4410)


def test_a_force_along_a_nodal_line_is_silence() -> None:
    """A mode that does not move along the force at the contact is not heard, whatever the others do."""
    gains = np.array([[0.0, 3.0], [2.0, 0.0], [1.0, -1.0]])  # axes by modes
    eigenvalues = [(2 * np.pi * 700) ** 2, (2 * np.pi * 1900) ** 2]
    nodal = np.array([1.0, 0.0, 0.0]) @ gains
    sound = mode_bank(eigenvalues, [3.0, 9.0], nodal, duration_s=0.1, sample_rate_hz=RATE)
    alone = mode_bank(eigenvalues[1:], [9.0], nodal[1:], duration_s=0.1, sample_rate_hz=RATE)
    np.testing.assert_allclose(sound, alone, atol=1e-13)
    assert not mode_bank(eigenvalues[:1], [3.0], nodal[:1], duration_s=0.1, sample_rate_hz=RATE).any()


def test_what_would_alias_is_left_out_by_its_damped_frequency() -> None:
    def heard(frequency: float, rate: float, damping: float = 0.0) -> bool:
        square = (2 * np.pi * frequency) ** 2
        return bool(mode_bank([square], [damping], [1.0], duration_s=0.1, sample_rate_hz=rate)[0].any())

    assert not heard(23000.0, 44100)
    assert not heard(7300.0, 16000)
    assert heard(7100.0, 16000)
    assert heard(7263.9, 16000)
    assert not heard(7264.1, 16000)
    assert heard(20_000.0, 44100)  # the whole band of modes at the default rate
    # sqrt(lambda - c^2) decides, not sqrt(lambda): the first rings at 4.4 kHz, the second does not ring.
    assert heard(7300.0, 16000, damping=2 * np.pi * 5800)
    assert heard(23000.0, 16000, damping=2 * np.pi * 23001)


@given(st.integers(0, 1000), st.floats(-200, -20), st.sampled_from([None, 5e-4]))
def test_what_is_dropped_stays_within_its_bound(seed: int, floor_db: float, pulse: float | None) -> None:
    random = np.random.default_rng(seed)
    eigenvalues = (2 * np.pi * random.uniform(50, 19000, 20)) ** 2
    dampings = np.sqrt(eigenvalues) * 10 ** random.uniform(-4, 1, 20)
    amplitudes = random.normal(size=20)
    whole = mode_bank(
        eigenvalues, dampings, amplitudes, duration_s=0.4, sample_rate_hz=RATE, floor_db=-600, pulse_s=pulse
    )
    cut = mode_bank(
        eigenvalues,
        dampings,
        amplitudes,
        duration_s=0.4,
        sample_rate_hz=RATE,
        floor_db=floor_db,
        pulse_s=pulse,
    )
    bound = 4 * 10 ** (floor_db / 20) * np.abs(amplitudes).sum() + 1e-13
    assert np.abs(whole - cut).max() <= bound


def test_most_work_is_saved_once_high_modes_have_died() -> None:
    eigenvalues, dampings = ceramic(256, 19800)
    oscillators = Oscillators.checked(eigenvalues, dampings, RATE)
    shares = {}
    for floor_db in (-220.0, -60.0):
        late = np.clip(oscillators.lifetimes(floor_db) - RATE // 10, 0, 2 * RATE - RATE // 10)
        shares[floor_db] = late.mean() / (2 * RATE - RATE // 10)
    assert shares[-60.0] < 0.15
    assert shares[-60.0] < shares[-220.0] < 0.5


def test_a_delay_moves_the_sound_by_any_part_of_a_sample() -> None:
    eigenvalues, dampings, amplitudes = modes(6, 5, 3000)
    fine = mode_bank(
        eigenvalues, dampings, amplitudes, duration_s=0.02, sample_rate_hz=8 * 12000, pulse_s=4e-4
    )
    for eighth in range(8):
        late = mode_bank(
            eigenvalues,
            dampings,
            amplitudes,
            duration_s=0.01,
            sample_rate_hz=12000,
            pulse_s=4e-4,
            delay_s=(16 + eighth) / 96000,
        )
        first = 2 + (eighth > 0)
        assert not late[:, :first].any()
        expected = fine[:, 8 * first - 16 - eighth :: 8][:, : late.shape[1] - first]
        np.testing.assert_allclose(late[:, first:], expected, atol=1e-11)


def test_a_sound_shorter_than_its_pulse_or_delay() -> None:
    eigenvalues, dampings, amplitudes = modes(3, 6, 5000)
    long = mode_bank(eigenvalues, dampings, amplitudes, duration_s=0.02, sample_rate_hz=RATE, pulse_s=0.01)
    short = mode_bank(eigenvalues, dampings, amplitudes, duration_s=0.002, sample_rate_hz=RATE, pulse_s=0.01)
    np.testing.assert_allclose(short, long[:, : short.shape[1]], atol=1e-12)
    assert not mode_bank(
        eigenvalues, dampings, amplitudes, duration_s=0.002, sample_rate_hz=RATE, delay_s=1.0
    ).any()


def test_one_million_contacts_in_bounded_memory(tmp_path: Path) -> None:
    contacts, samples = 1_000_000, 16
    amplitudes = np.lib.format.open_memmap(tmp_path / "a.npy", "w+", np.float32, (contacts, 8))
    for start in range(0, contacts, 100_000):
        amplitudes[start : start + 100_000] = np.random.default_rng(start).normal(size=(100_000, 8))
    out = np.lib.format.open_memmap(tmp_path / "s.npy", "w+", np.float32, (contacts, samples))
    eigenvalues, dampings = ceramic(8, 18000)
    tracemalloc.start()
    try:
        sound = mode_bank(
            eigenvalues, dampings, amplitudes, duration_s=samples / RATE, sample_rate_hz=RATE, out=out
        )
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert sound is out
    assert peak < 120e6
    for contact in (0, 131_072, 999_999):
        alone = mode_bank(
            eigenvalues, dampings, amplitudes[contact], duration_s=samples / RATE, sample_rate_hz=RATE
        )
        assert_equal_but_for_rounding(alone[0].astype(np.float32), out[contact])


def test_what_is_impossible_is_refused_by_name(subtests: pytest.Subtests) -> None:
    for change, where in [
        ({"eigenvalues": [1e7, 1e8]}, "dampings_per_s"),
        ({"amplitudes": [[1.0, 2.0]]}, "amplitudes"),
        ({"eigenvalues": [-1.0]}, "eigenvalues"),
        ({"eigenvalues": [0.0]}, "eigenvalues"),
        ({"eigenvalues": [np.nan]}, "eigenvalues"),
        ({"eigenvalues": [1e200]}, "eigenvalues"),
        ({"dampings_per_s": [-1.0]}, "dampings_per_s"),
        ({"dampings_per_s": [np.nan]}, "dampings_per_s"),
        ({"amplitudes": [[np.inf]]}, "amplitudes"),
        ({"amplitudes": [[np.nan]]}, "amplitudes"),
        ({"duration_s": 0}, "duration_s"),
        ({"duration_s": np.nan}, "duration_s"),
        ({"sample_rate_hz": np.nan}, "sample_rate_hz"),
        ({"sample_rate_hz": -1}, "sample_rate_hz"),
        ({"response": "pressure"}, "response"),
        ({"pulse_s": 0.0}, "pulse_s"),
        ({"pulse_s": np.nan}, "pulse_s"),
        ({"pulse_s": [1e-3, 1e-3]}, "pulse_s"),
        ({"delay_s": -1e-3}, "delay_s"),
        ({"delay_s": np.nan}, "delay_s"),
        ({"floor_db": 0.0}, "floor_db"),
        ({"floor_db": -np.inf}, "floor_db"),
        ({"floor_db": np.nan}, "floor_db"),
        ({"out": np.zeros((1, 3))}, "out"),
        ({"out": np.zeros((1, 4410), dtype=int)}, "out"),
    ]:
        with subtests.test(change=change):
            arguments = {
                "eigenvalues": [1e7],
                "dampings_per_s": [1.0],
                "amplitudes": [[1.0]],
                "duration_s": 0.1,
                "sample_rate_hz": 44100,
            } | change
            with pytest.raises(QueryError, match=where):
                mode_bank(**arguments)


@given(
    st.lists(st.tuples(st.floats(-30, 59), st.floats(-30, 29)), min_size=1, max_size=3),
    st.floats(-2, 6),
    st.integers(0, 40),
    st.one_of(st.none(), st.floats(-12, 3)),
    st.sampled_from(["displacement", "velocity", "acceleration"]),
)
def test_no_magnitude_overflows(
    exponents: list[tuple[float, float]], rate: float, samples: int, pulse: float | None, response: str
) -> None:
    """Warnings of overflow are errors here."""
    eigenvalues, dampings = 10.0 ** np.array(exponents).T
    rate = 10.0**rate
    sound = mode_bank(
        eigenvalues,
        dampings,
        np.ones(len(exponents)),
        duration_s=max(samples, 0.3) / rate,
        sample_rate_hz=rate,
        response=response,
        pulse_s=None if pulse is None else 10.0**pulse / rate,
    )
    assert sound.shape == (1, samples)
    assert np.isfinite(sound).all()
