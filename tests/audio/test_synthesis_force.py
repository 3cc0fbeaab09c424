"""Forces that last: half-sine pulses and sampled forces against independent integration."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rounding import assert_equal_but_for_rounding
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

from objectfolder.audio.synthesis import driven_bank, mode_bank
from objectfolder.errors import QueryError

RATE = 44100
OMEGA = 2 * np.pi * 1000.0
# Ringing lightly and heavily, undamped, near and at critical damping, beyond, and far beyond.
DAMPING_RATIOS = (0.0, 1e-3, 0.3, 0.999999, 1.0, 1.000001, 1.1, 1.2, 20.0)


def integrated(
    eigenvalue: float, damping: float, force, end: float, times: np.ndarray, breaks: list[float]
) -> np.ndarray:
    """Displacement and velocity (2, times) from rest by an adaptive Runge-Kutta of order 8."""

    def motion(t, state):
        return [state[1], force(t) - 2 * damping * state[1] - eigenvalue * state[0]]

    states = np.zeros((2, len(times)))
    state = np.zeros(2)
    edges = [0.0, *breaks, end]
    for begin, stop in pairwise(edges):
        inside = (times >= begin) & (times <= stop)
        solved = solve_ivp(
            motion,
            (begin, stop),
            state,
            "DOP853",
            t_eval=np.append(times[inside], stop),
            rtol=1e-13,
            atol=1e-17,
        )
        states[:, inside] = solved.y[:, :-1]
        state = solved.y[:, -1]
    return states


@pytest.mark.parametrize(
    ("ratio", "pulse_s"),
    [
        *((ratio, 4.9e-4) for ratio in DAMPING_RATIOS),
        (DAMPING_RATIOS[1], 3.3e-5),
        (DAMPING_RATIOS[1], 2.01e-3),
    ],
)
def test_a_half_sine_is_what_runge_kutta_finds(ratio: float, pulse_s: float) -> None:
    damping = ratio * OMEGA
    rate = 8000

    def force(t: float) -> float:
        return np.pi / (2 * pulse_s) * np.sin(np.pi * t / pulse_s) if t <= pulse_s else 0.0

    samples = 40
    times = np.arange(samples) / rate
    truth = integrated(OMEGA**2, damping, force, samples / rate, times, [pulse_s])
    for row, response in enumerate(("displacement", "velocity")):
        sound = mode_bank(
            [OMEGA**2],
            [damping],
            [1.0],
            duration_s=samples / rate,
            sample_rate_hz=rate,
            response=response,
            pulse_s=pulse_s,
        )
        np.testing.assert_allclose(sound[0], truth[row], atol=2e-11 * np.abs(truth[row]).max(), rtol=0)


@pytest.mark.parametrize(
    ("detuning", "damping"),
    [(0.0, 0.0), (1e-14, 0.0), (1e-9, 1e-6), (1e-6, 0.0), (1e-3, 1.0), (0.01, 0.0), (0.03, 1e-6)],
)
def test_a_mode_in_resonance_with_its_pulse_has_no_small_denominator(detuning: float, damping: float) -> None:
    """At W = w without damping the displacement is F0 (sin(w t) - w t cos(w t)) / (2 w^2)."""
    pulse_s = np.pi / OMEGA
    root = OMEGA * (1 + detuning)

    def force(t: float) -> float:
        return OMEGA / 2 * np.sin(OMEGA * t) if t <= pulse_s else 0.0

    times = np.arange(60) / RATE
    truth = integrated(root**2 + damping**2, damping, force, 60 / RATE, times, [pulse_s])
    sound = mode_bank(
        [root**2 + damping**2], [damping], [1.0], duration_s=60 / RATE, sample_rate_hz=RATE, pulse_s=pulse_s
    )[0]
    np.testing.assert_allclose(sound, truth[1], atol=1e-11, rtol=0)
    if detuning == damping == 0:
        during = times <= pulse_s
        closed = OMEGA / 2 * times * np.sin(OMEGA * times) / 2
        np.testing.assert_allclose(sound[during], closed[during], atol=1e-13)


def test_a_short_pulse_becomes_the_impulse() -> None:
    eigenvalues, dampings = [OMEGA**2, (9 * OMEGA) ** 2], [30.0, 300.0]
    ideal = mode_bank(eigenvalues, dampings, [1.0, 0.5], duration_s=0.05, sample_rate_hz=RATE)[0, 1:]
    for pulse_s, reach in ((1e-6, 0.1), (1e-8, 1e-3), (1e-10, 1e-5)):
        pulsed = mode_bank(
            eigenvalues, dampings, [1.0, 0.5], duration_s=0.05, sample_rate_hz=RATE, pulse_s=pulse_s
        )[0, 1:]
        assert np.abs(pulsed - ideal).max() < reach


def foh_truth(eigenvalue: float, damping: float, force: np.ndarray, samples: int, rate: float) -> np.ndarray:
    """Displacement and velocity (samples, 2) of the first-order hold, stepped by scipy's exponential."""
    a = np.array([[0.0, 1.0], [-eigenvalue, -2 * damping]])
    # States of x' = A x + B u and of u' = d, with d the slope over a sample.
    whole = np.zeros((4, 4))
    whole[:2, :2], whole[1, 2], whole[2, 3] = a, 1.0, 1.0
    system = (whole, np.zeros((4, 1)), np.eye(4), np.zeros((4, 1)))
    step = cont2discrete(system, 1 / rate, "zoh")[0]
    padded = np.zeros(samples + 1)
    padded[: min(len(force), samples + 1)] = force[: samples + 1]
    state, states = np.zeros(2), np.zeros((samples, 2))
    for k in range(samples):
        states[k] = state
        state = (step @ np.array([*state, padded[k], (padded[k + 1] - padded[k]) * rate]))[:2]
    return states


@pytest.mark.parametrize(
    ("ratio", "omega"),
    [
        *((ratio, 2 * np.pi * 440.0) for ratio in DAMPING_RATIOS),
        (DAMPING_RATIOS[1], 2 * np.pi * 5.0),
        (DAMPING_RATIOS[1], 2 * np.pi * 17000.0),
    ],
)
def test_sampled_forces_are_what_stepping_the_matrix_exponential_finds(ratio: float, omega: float) -> None:
    force = np.random.default_rng(3).normal(size=301)
    truth = foh_truth(omega**2, ratio * omega, force, 500, RATE)
    for row, response in enumerate(("displacement", "velocity")):
        sound = driven_bank(
            [omega**2],
            [ratio * omega],
            [[1.0]],
            force[:, None],
            duration_s=500 / RATE,
            sample_rate_hz=RATE,
            response=response,
        )
        np.testing.assert_allclose(sound[0], truth[:, row], atol=2e-11 * np.abs(truth[:, row]).max(), rtol=0)


@given(st.integers(1, 700), st.integers(1, 700), st.integers(0, 100))
def test_any_length_of_force_and_of_sound(force_samples: int, samples: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    omega, damping = random.uniform(100, 1e5, 2), random.uniform(0, 3e4, 2)
    gains, force = random.normal(size=(3, 2)), random.normal(size=(force_samples, 3))
    sound = driven_bank(omega**2, damping, gains, force, duration_s=samples / RATE, sample_rate_hz=RATE)[0]
    truth = np.zeros(samples)
    for mode in range(2):
        if omega[mode] ** 2 - damping[mode] ** 2 <= (0.454 * RATE * 2 * np.pi) ** 2:
            truth += foh_truth(omega[mode] ** 2, damping[mode], force @ gains[:, mode], samples, RATE)[:, 1]
    assert sound.shape == (samples,)
    np.testing.assert_allclose(sound, truth, atol=1e-10 * max(np.abs(truth).max(), 1e-6), rtol=0)


def test_a_sampled_half_sine_converges_to_the_closed_form() -> None:
    pulse_s, errors = 2e-3, []
    for rate in (48000, 96000, 192000):
        times = np.arange(round(pulse_s * rate) + 1) / rate
        force = np.pi / (2 * pulse_s) * np.sin(np.pi * times / pulse_s)
        sampled = driven_bank(
            [OMEGA**2], [50.0], [[1.0]], force[:, None], duration_s=0.01, sample_rate_hz=rate
        )[0]
        exact = mode_bank([OMEGA**2], [50.0], [1.0], duration_s=0.01, sample_rate_hz=rate, pulse_s=pulse_s)[0]
        errors.append(np.abs(sampled - exact).max())
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)


def test_contacts_of_a_batch_do_not_depend_on_one_another_and_zero_is_zero() -> None:
    random = np.random.default_rng(4)
    eigenvalues, dampings = random.uniform(100, 1e5, 7) ** 2, random.uniform(0, 1e4, 7)
    gains, forces = random.normal(size=(3, 3, 7)), random.normal(size=(3, 150, 3))
    forces[1] = 0
    together = driven_bank(
        eigenvalues, dampings, gains, forces, duration_s=0.02, sample_rate_hz=RATE, delay_samples=9
    )
    assert not together[1].any()
    assert not together[:, :9].any()
    for index in range(3):
        alone = driven_bank(
            eigenvalues,
            dampings,
            gains[index],
            forces[index],
            duration_s=0.02,
            sample_rate_hz=RATE,
            delay_samples=9,
        )
        assert_equal_but_for_rounding(alone[0], together[index])


def test_impossible_forces_are_refused(subtests: pytest.Subtests) -> None:
    for change in [
        {"forces_n": np.full((4, 3), np.nan)},
        {"gains": np.full((3, 2), np.inf)},
        {"forces_n": np.zeros((4, 2))},
        {"gains": np.zeros((3, 3))},
        {"delay_samples": -1},
    ]:
        with subtests.test(change=change):
            arguments = {
                "eigenvalues": [1e7, 2e7],
                "dampings_per_s": [1.0, 1.0],
                "gains": np.ones((3, 2)),
                "forces_n": np.ones((4, 3)),
                "duration_s": 0.01,
                "sample_rate_hz": RATE,
            } | change
            with pytest.raises(QueryError):
                driven_bank(**arguments)


@given(
    st.lists(st.tuples(st.floats(-30, 59), st.floats(-30, 29)), min_size=1, max_size=3),
    st.floats(-2, 6),
    st.integers(1, 40),
)
def test_no_magnitude_overflows(exponents: list[tuple[float, float]], rate: float, samples: int) -> None:
    """Warnings of overflow are errors here."""
    eigenvalues, dampings = 10.0 ** np.array(exponents).T
    gains, rate = np.ones((1, len(exponents))), 10.0**rate
    assert np.isfinite(
        driven_bank(
            eigenvalues, dampings, gains, np.ones((7, 1)), duration_s=samples / rate, sample_rate_hz=rate
        )
    ).all()
