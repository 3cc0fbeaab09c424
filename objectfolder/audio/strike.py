"""The sound of struck modes: a bank of decaying sines at true amplitude.

Amplitude contract. An impulse J (newton seconds) at a point x starts mode i with the modal velocity
phi_i(x) . J,
phi_i of unit modal mass (kg^-1/2). The part of it that moves air is the normal velocity of the surface,
whose root mean square over the surface is r_i per unit of modal velocity (`radiation_weights`). The sound is

    s(t) = sum_i amplitude_i exp(-c_i t) sin(2 pi f_i t),     amplitude_i = (phi_i(x) . J) r_i,

in metres a second: it starts from zero, is linear in J, and nothing is normalised.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.errors import QueryError

Floats = NDArray[np.float64]
# Modes nearer to half the sample rate than this would sound at another pitch.
HIGHEST_RATIO = 0.45


def strike(
    frequencies_hz: ArrayLike,
    dampings_per_s: ArrayLike,
    amplitudes: ArrayLike,
    duration_s: float,
    sample_rate_hz: float,
) -> NDArray[np.float32]:
    """Sum of decaying sines.

    Parameters
    ----------
    frequencies_hz
        (modes,) damped eigenfrequencies; those above 0.45 of the sample rate are left out.
    dampings_per_s
        (modes,) decay rates c of the amplitude.
    amplitudes
        (n, modes) or (modes,), metres a second.

    Returns
    -------
    ndarray
        (n, samples) float32, samples = round(duration_s sample_rate_hz), the first at t = 0. Computed in
        float64; a row does not depend on the other rows.

    Raises
    ------
    QueryError
        Values that are not finite, negative frequencies or dampings (a mode that does not ring has no
        frequency), a duration or rate that is not positive, or shapes that do not agree.
    """
    frequencies = np.asarray(frequencies_hz, dtype=np.float64).reshape(-1)
    dampings = np.asarray(dampings_per_s, dtype=np.float64).reshape(-1)
    given = np.atleast_2d(np.asarray(amplitudes, dtype=np.float64))
    if dampings.shape != frequencies.shape or given.ndim != 2 or given.shape[1] != len(frequencies):
        raise QueryError(
            "amplitudes",
            f"shape {given.shape} for {len(frequencies)} frequencies and {len(dampings)} dampings",
            "Give (n, modes).",
        )
    for name, values in (("frequencies_hz", frequencies), ("dampings_per_s", dampings)):
        if not (np.isfinite(values).all() and (values >= 0).all()):
            raise QueryError(name, "negative or not finite", "Leave out modes that do not ring.")
    if not np.isfinite(given).all():
        raise QueryError("amplitudes", "not finite", "Give finite impulses.")
    if not (math.isfinite(duration_s * sample_rate_hz) and duration_s > 0 and sample_rate_hz > 0):
        raise QueryError(
            "duration_s, sample_rate_hz", f"{duration_s} s, {sample_rate_hz} Hz", "Give positive numbers."
        )
    samples = round(duration_s * sample_rate_hz)
    audible = frequencies <= HIGHEST_RATIO * sample_rate_hz
    rate = -dampings[audible] + 2j * np.pi * frequencies[audible]
    given = given[:, audible]

    # exp(rate t) at sample b B + j is a product of two short tables; the sum over modes is a matrix product.
    inner = max(1, math.isqrt(max(samples - 1, 0)) + 1)
    outer = -(-samples // inner) if samples else 0
    coarse = np.exp(np.outer(np.arange(outer) * (inner / sample_rate_hz), rate))
    fine = np.exp(np.outer(rate, np.arange(inner) / sample_rate_hz))
    columns = np.concatenate([coarse.real, coarse.imag], axis=1)
    rows = np.concatenate([fine.imag, fine.real], axis=0)
    sound = np.zeros((len(given), samples), dtype=np.float32)
    for index, amplitude in enumerate(given):
        weighted = columns * np.concatenate([amplitude, amplitude])
        sound[index] = (weighted @ rows).reshape(-1)[:samples]
    return sound
