"""The mode bank: modes that ring after an impulse or a pulse, or under sampled forces.

Amplitude contract. An impulse J (newton seconds) at a point x gives mode i the modal velocity phi_i(x) . J,
phi_i of unit modal mass (kg^-1/2). The part of a mode that moves air is the normal velocity of the surface,
whose root mean square over the surface is r_i per unit of modal velocity (`radiation_weights`). With
amplitudes a_i = (phi_i(x) . J) r_i the velocity response is

    s(t) = sum_i a_i exp(-c_i t) (cos w_i t - (c_i / w_i) sin w_i t),   w_i^2 = lambda_i - c_i^2,

in metres a second: the true velocity of the modes (an impulse makes it jump at t = 0; a pulse of finite
length makes it continuous), linear in J; nothing is normalised. Displacement (m) and acceleration (m/s^2,
without the delta of an ideal impulse) are the same modes' q and q''.

Under forces given as samples the bank is exact for the force that is linear between them.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.synthesis.pulses import Course, ForceProfile, HalfSine, course_of
from objectfolder.audio.synthesis.resonators import FLOOR_DB, Resonators
from objectfolder.errors import QueryError
from objectfolder.renaming import formerly_positional, renamed_keywords

Floats = NDArray[np.float64]
Pulse = float | Floats | list[ForceProfile] | None  # of half-sines, or a course for each
BANK_NUMBERS = 1 << 20  # of sound and of coefficients at once


@formerly_positional
def mode_bank(
    eigenvalues: ArrayLike,
    dampings_per_s: ArrayLike,
    amplitudes: ArrayLike,
    *,
    duration_s: float = 2.0,
    sample_rate_hz: float = 44100.0,
    response: str = "velocity",
    pulse_s: float | ArrayLike | None = None,
    delay_s: float = 0.0,
    floor_db: float = FLOOR_DB,
    out: NDArray[np.floating] | None = None,
) -> NDArray[np.floating]:
    """Sound of struck modes.

    Parameters
    ----------
    eigenvalues
        (modes,) undamped omega^2, rad^2/s^2, positive; modes whose damped frequency is above 0.454 of the
        sample rate are left out, over- and critically damped ones are not.
    dampings_per_s
        (modes,) decay rates c, not negative.
    amplitudes
        (n, modes) or (modes,), modal velocity that the whole impulse gives.
    response
        ``velocity``, ``displacement`` or ``acceleration``.
    pulse_s
        Durations of half-sine pulses that carry the impulses, one or (n,); ideal impulses if None.
    delay_s
        When the impulse or the pulse begins, not negative; it need not fall on a sample.
    floor_db
        A mode is dropped where it stays this far below its own start, from -600 to below 0. What is dropped
        of an impulse's velocity is at most 4 10^(floor_db / 20) sum |amplitudes|: 4e-11 by default.
    out
        (n, samples) floating array to write to, for instance a memory map; of any precision.

    Returns
    -------
    ndarray
        (n, samples) float64 or `out`; samples = round(duration_s sample_rate_hz), the first at t = 0. The
        error in the first ten seconds is below 1e-9 sum |amplitudes|; it grows with time, to 1e-7 after an
        hour without damping. A row has the same bits whatever the other rows are. Working memory does not
        grow with n.

    Raises
    ------
    QueryError
        Values that are not finite or out of the ranges above, or shapes that do not agree.

    Examples
    --------
    >>> import numpy as np
    >>> tone = mode_bank([(2 * np.pi * 440) ** 2], [3.0], [1.0], duration_s=1.0, sample_rate_hz=44100)
    >>> tone.shape, float(tone[0, 0])  # an impulse makes the velocity jump to its amplitude
    ((1, 44100), 1.0)
    >>> int(abs(np.fft.rfft(tone[0])).argmax())  # hertz
    440
    """
    bank = Resonators.of_modes(eigenvalues, dampings_per_s, sample_rate_hz, response, floor_db)
    gains = np.atleast_2d(np.asarray(amplitudes))
    if gains.ndim != 2 or gains.shape[1] != bank.width:
        raise QueryError("amplitudes", f"shape {gains.shape} for {bank.width} modes", "Give (n, modes).")
    sound = sound_array(out, len(gains), samples_of(duration_s, sample_rate_hz))
    pulse = None if pulse_s is None else np.asarray(pulse_s, dtype=np.float64)
    ring(bank, gains, sound, pulse=pulse, delay_s=delay_s)
    return sound


def ring(
    bank: Resonators,
    amplitudes: NDArray[np.floating],
    sound: NDArray[np.floating],
    *,
    pulse: Pulse = None,
    delay_s: float = 0.0,
) -> None:
    """Write what contacts sound into `sound`; see `mode_bank`.

    Parameters
    ----------
    amplitudes
        (n, width of the bank).
    sound
        (n, samples), overwritten.
    pulse
        Durations of half-sines, or a course of force for each.
    """
    courses = _courses(pulse, len(amplitudes))
    if not 0 <= delay_s < math.inf:
        raise QueryError("delay_s", f"{delay_s} s", "Give a delay that is not negative.")
    delay, samples = delay_s * bank.oscillators.sample_rate_hz, sound.shape[1]
    begin, ahead = min(math.ceil(delay), samples), math.ceil(delay) - delay
    most = max(1, BANK_NUMBERS // max(1, samples - begin + 4 * len(bank)))
    for rows, course in courses:
        for start in range(0, len(rows), most):
            part = rows[start : start + most]
            some = slice(part[0], part[-1] + 1) if part[-1] - part[0] < len(part) else part
            chunk = np.asarray(amplitudes[some], dtype=np.float64)
            if not np.isfinite(chunk).all():
                raise QueryError("amplitudes", "not finite", "Give finite impulses.")
            onset = bank.onset(chunk.take(bank.columns, axis=1), course, ahead, samples - begin)
            # Written in place where the kernel can: pages of new memory cost more than the sound.
            in_place = isinstance(some, slice) and sound.dtype == np.float64 and sound.flags.c_contiguous
            target = np.asarray(sound[some]) if in_place else np.empty((len(chunk), samples))
            _write(bank, *onset, begin, target)
            if not in_place:
                sound[some] = target


def _write(bank: Resonators, onset: Floats, states: Floats, begin: int, sound: Floats) -> None:
    """Write onsets from a sample on, and what rings after them."""
    free = begin + onset.shape[1]
    sound[:, :begin], sound[:, begin:free], sound[:, free:] = 0, onset, 0
    bank.ring(states, sound, free)


def samples_of(duration_s: float, sample_rate_hz: float) -> int:
    """Return how many samples a duration has.

    Raises
    ------
    QueryError
        A duration or rate that is not positive and finite.
    """
    if not (math.isfinite(duration_s * sample_rate_hz) and duration_s > 0 and sample_rate_hz > 0):
        raise QueryError(
            "duration_s, sample_rate_hz", f"{duration_s} s, {sample_rate_hz} Hz", "Give positive numbers."
        )
    return round(duration_s * sample_rate_hz)


def sound_array(out: NDArray[np.floating] | None, contacts: int, samples: int) -> NDArray[np.floating]:
    """Return `out` after a check, or a new float64 array.

    Raises
    ------
    QueryError
        An `out` of another shape or kind.
    """
    if out is None:
        return np.empty((contacts, samples))
    if out.shape != (contacts, samples) or not np.issubdtype(out.dtype, np.floating):
        raise QueryError("out", f"{out.dtype} {out.shape}", f"Give floats of shape ({contacts}, {samples}).")
    return out


def _courses(pulse: Pulse, contacts: int) -> list[tuple[NDArray[np.int64], Course]]:
    """Rows of contacts, ascending, with forces of one course each."""
    every = np.arange(contacts)
    if isinstance(pulse, list):
        return list(zip(every[:, None], pulse, strict=True))
    durations = np.asarray(pulse, dtype=np.float64)
    if pulse is None or durations.shape in ((), (1,)):
        return [(every, None if pulse is None else course_of(durations.item()))]
    if durations.shape != (contacts,):
        raise QueryError(
            "pulse_s", f"shape {durations.shape} for {contacts} contacts", "Give one or one each."
        )
    order = np.argsort(durations, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(durations[order])) + 1)
    return [(rows, HalfSine(float(durations[rows[0]]))) for rows in groups]


@renamed_keywords(forces="forces_n")
@formerly_positional
def driven_bank(
    eigenvalues: ArrayLike,
    dampings_per_s: ArrayLike,
    gains: ArrayLike,
    forces_n: ArrayLike,
    *,
    duration_s: float = 2.0,
    sample_rate_hz: float = 44100.0,
    response: str = "velocity",
    delay_samples: int = 0,
    floor_db: float = FLOOR_DB,
    out: NDArray[np.floating] | None = None,
) -> NDArray[np.floating]:
    """Sound of modes under sampled forces.

    Parameters
    ----------
    eigenvalues, dampings_per_s, response, floor_db, out
        As for `mode_bank`.
    gains
        (n, directions, modes) or (directions, modes): modal velocity an impulse of 1 N s gives.
    forces_n
        (n, k, directions) or (k, directions) newtons at the samples from t = 0 on, linear between them, and
        to zero within one sample after the last; a first sample that is not zero is a jump.
    delay_samples
        When the force begins.

    Returns
    -------
    ndarray
        (n, samples) float64 or `out`. Linear in the forces; a contact does not depend on others.

    Raises
    ------
    QueryError
        As for `mode_bank`.

    Examples
    --------
    >>> import numpy as np
    >>> push = np.zeros((100, 1))
    >>> push[50] = 44100.0  # newtons, over one sample: an impulse of 1 N s
    >>> tone = driven_bank([(2 * np.pi * 440) ** 2], [3.0], [[1.0]], push, duration_s=0.1)
    >>> bool((tone[0, :50] == 0).all()), float(tone[0, 51].round(2))
    (True, 1.0)
    """
    bank = Resonators.of_modes(eigenvalues, dampings_per_s, sample_rate_hz, response, floor_db)
    fields, pushes = checked_forces(gains, forces_n, bank.width)
    if not delay_samples >= 0:
        raise QueryError("delay_samples", f"{delay_samples}", "Give a delay that is not negative.")
    sound = sound_array(out, len(fields), samples_of(duration_s, sample_rate_hz))
    drive(bank, fields, pushes, sound, delay_samples=delay_samples)
    return sound


def checked_forces(gains: ArrayLike, forces: ArrayLike, modes: int) -> tuple[Floats, Floats]:
    """Gains (n, directions, modes) and forces (n, k, directions) that agree."""
    fields, pushes = np.asarray(gains, dtype=np.float64), np.asarray(forces, dtype=np.float64)
    fields = fields[None] if fields.ndim == 2 else fields
    pushes = pushes[None] if pushes.ndim == 2 else pushes
    agree = fields.ndim == pushes.ndim == 3 and fields.shape[:2] == (len(pushes), pushes.shape[2])
    if not agree or fields.shape[2] != modes:
        raise QueryError(
            "gains, forces_n",
            f"shapes {fields.shape} and {pushes.shape} for {modes} modes",
            "Give (n, directions, modes) and (n, k, directions).",
        )
    if not (np.isfinite(fields).all() and np.isfinite(pushes).all()):
        raise QueryError("gains, forces_n", "not finite", "Give numbers.")
    return fields, pushes


def drive(
    bank: Resonators, gains: Floats, forces: Floats, sound: NDArray[np.floating], *, delay_samples: int = 0
) -> None:
    """Write into `sound` (n, samples) oscillators under forces (n, k, directions); see `driven_bank`."""
    samples = sound.shape[1]
    begin, buffer = min(delay_samples, samples), np.empty((1, samples))
    for row, gain, force in zip(sound, gains[:, :, bank.columns], forces, strict=True):
        _write(bank, *bank.drive(gain, force, samples - begin), begin, buffer)
        row[:] = buffer[0]
