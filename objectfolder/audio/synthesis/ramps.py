"""What a force does to oscillators over one sample, in closed form."""

import math

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.oscillators import Oscillators

Floats = NDArray[np.float64]
SERIES_TERMS = 24
SERIES_REACH = 1.0  # of (c + omega) h, up to which the Taylor series is summed


def held_steps(oscillators: Oscillators) -> Floats:
    """Return what one sample does under a force that is held, (6, modes).

    They are the displacement after a unit of displacement and after a unit of velocity, the velocity after
    these, and both after a unit of force from rest.
    """
    zeros, ones = np.zeros(len(oscillators)), np.ones(len(oscillators))
    first, second = (row[0] for row in oscillators.basis([1.0]))
    rows = []
    for response in ("displacement", "velocity"):
        for state in ((ones, zeros), (zeros, ones)):
            a, b = oscillators.coefficients(oscillators.response_weights(response), *state)
            rows.append(a * first + b * second)
    falling, rising = ramp_responses(oscillators)
    return np.array([*rows, falling[0] + rising[0], falling[1] + rising[1]])


def ramp_responses(oscillators: Oscillators) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """State after one sample from rest under a force falling from 1 to 0, and rising from 0 to 1.

    With S the impulse response, I its integral and K that of I over the sample h, the rising force leaves
    displacement K / h and velocity I / h; with the constant force, I and S, the falling one follows.

    Returns
    -------
    tuple
        ((modes,), (modes,)) displacement and velocity of each.
    """
    h = 1 / oscillators.sample_rate_hz
    once, twice, thrice = _integrals(oscillators, h)
    return (twice - thrice / h, once - twice / h), (thrice / h, twice / h)


def _integrals(oscillators: Oscillators, h: float) -> tuple[Floats, Floats, Floats]:
    """S(h), its integral and its second integral, (modes,) each, without cancellation."""
    squares, damping = oscillators.eigenvalues, oscillators.dampings_per_s
    first, second = (row[0] for row in oscillators.basis([1.0]))
    with np.errstate(over="ignore", invalid="ignore"):
        cosine_like = 1 - first - damping * second
        once = second
        twice = cosine_like / squares
        thrice = (h - second - 2 * damping * twice) / squares
    apart = oscillators.apart
    if apart.any():
        slow, fast = (rate[apart] for rate in oscillators.rates_per_s)
        width = fast - slow
        once, twice, thrice = once.copy(), twice.copy(), thrice.copy()
        for target, order in ((once, 0), (twice, 1), (thrice, 2)):
            target[apart] = h**order * (_phi(-slow * h, order) - _phi(-fast * h, order)) / width
    small = (damping + np.sqrt(squares)) * h < SERIES_REACH
    if small.any():
        taylor = _taylor(squares[small], damping[small], h)
        for target, values in zip((once, twice, thrice), taylor, strict=True):
            target[small] = values
    return once, twice, thrice


def _taylor(squares: Floats, damping: Floats, h: float) -> tuple[Floats, Floats, Floats]:
    """The same by S(h) = sum of s_k h^k / k!, s_0 = 0, s_1 = 1, s_(k+2) = -2 c s_(k+1) - lambda s_k."""
    sums = [np.zeros_like(squares) for _ in range(3)]
    before, now = np.zeros_like(squares), np.full_like(squares, h)  # s_k h^k
    for k in range(1, SERIES_TERMS):
        for order, total in enumerate(sums):
            total += now * (h**order / math.factorial(k + order))
        before, now = now, -2 * damping * h * now - squares * h * h * before
    return sums[0], sums[1], sums[2]


def _phi(z: Floats, order: int) -> Floats:
    """exp(z), (exp(z) - 1) / z, (exp(z) - 1 - z) / z^2 for orders 0, 1, 2."""
    if order == 0:
        return np.exp(z)
    safe = np.where(z == 0, 1.0, z)
    once = np.where(z == 0, 1.0, np.expm1(safe) / safe)
    if order == 1:
        return once
    series, near = np.zeros_like(z), np.clip(z, -1, 1)
    for k in range(SERIES_TERMS, 1, -1):
        series = 1 / math.factorial(k) + near * series
    # The loop ends with 1 / 2! + z / 3! + ...
    return np.where(np.abs(z) < 1, series, (once - 1) / safe)
