"""The mode bank: all contacts of a batch as one product.

Amplitude contract. An impulse J (newton seconds) at a point x gives mode i the modal velocity phi_i(x) . J,
phi_i of unit modal mass (kg^-1/2). The part of a mode that moves air is the normal velocity of the surface,
whose root mean square over the surface is r_i per unit of modal velocity (`radiation_weights`). With
amplitudes a_i = (phi_i(x) . J) r_i the velocity response is

    s(t) = sum_i a_i exp(-c_i t) (cos w_i t - (c_i / w_i) sin w_i t),   w_i^2 = lambda_i - c_i^2,

in metres a second: the true velocity of the modes (an impulse makes it jump at t = 0; a pulse of finite
length makes it continuous), linear in J; nothing is normalised. Displacement (m) and acceleration (m/s^2,
without the delta of an ideal impulse) are the same modes' q and q''.

Free motion at sample b B + j is a product of two short tables, one over blocks b and one over samples j
of a block, so that a sound is the matrix product of (blocks, 2 modes) with (2 modes, samples of a block).
Modes are in the order of their lifetimes, and a block has those that still live.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.synthesis.half_sine import HalfSine
from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.errors import QueryError
from objectfolder.renaming import formerly_positional

Floats = NDArray[np.float64]
FLOOR_DB = -220.0
LOWEST_FLOOR_DB = -600.0  # beyond, numbers would leave the range of full precision
LONGEST_BLOCK = 1024
CHUNK_NUMBERS = 1 << 20  # of coefficients at once
PRODUCT_NUMBERS = 1 << 17  # of weighted rows multiplied at once: they stay in the cache
SEGMENT_BLOCKS = 512


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
        (modes,) undamped omega^2, rad^2/s^2, positive; modes whose damped frequency is above 0.45 of the
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
    oscillators = Oscillators.checked(eigenvalues, dampings_per_s, sample_rate_hz)
    given = np.atleast_2d(np.asarray(amplitudes))
    if given.ndim != 2 or given.shape[1] != len(oscillators):
        finding = f"shape {given.shape} for {len(oscillators)} modes"
        raise QueryError("amplitudes", finding, "Give (n, modes).")
    sound = sound_array(out, len(given), samples_of(duration_s, sample_rate_hz))
    columns = np.flatnonzero(oscillators.audible())
    sounding = oscillators.take(columns)
    weights = sounding.response_weights(response)
    ring(sounding, weights, given, sound, columns, pulse_s=pulse_s, delay_s=delay_s, floor_db=floor_db)
    return sound


def ring(
    oscillators: Oscillators,
    weights: tuple[Floats, Floats],
    amplitudes: NDArray[np.floating],
    sound: NDArray[np.floating],
    columns: NDArray[np.int64] | None = None,
    *,
    pulse_s: float | ArrayLike | None = None,
    delay_s: float = 0.0,
    floor_db: float = FLOOR_DB,
) -> None:
    """Write the sound of oscillators into `sound`; see `mode_bank`.

    Parameters
    ----------
    weights
        (modes,) of displacement and velocity in what is heard.
    amplitudes
        (n, all modes) of which `columns` are those of `oscillators`.
    sound
        (n, samples), overwritten.
    """
    durations = _durations(pulse_s, len(amplitudes))
    if not (math.isfinite(delay_s) and delay_s >= 0):
        raise QueryError("delay_s", f"{delay_s} s", "Give a delay that is not negative.")
    columns = np.arange(len(oscillators)) if columns is None else columns
    bank = Bank(oscillators, weights, sound.shape[1], floor_db)
    columns = columns[bank.order]
    delay = delay_s * oscillators.sample_rate_hz
    begin = math.ceil(delay)
    for rows, pulse in _groups(durations, len(amplitudes), max(1, CHUNK_NUMBERS // max(1, len(columns)))):
        chunk = np.asarray(amplitudes[rows], dtype=np.float64)
        if not np.isfinite(chunk).all():
            raise QueryError("amplitudes", "not finite", "Give finite impulses.")
        target = sound[rows]  # a view, but for rows that are a list
        target[:, :begin] = 0
        bank.strike(np.ascontiguousarray(chunk[:, columns]), target[:, begin:], pulse, begin - delay)
        if not isinstance(rows, slice):
            sound[rows] = target


class Bank:
    """Tables of oscillators for sounds of up to `samples` samples.

    Attributes
    ----------
    order : (modes,) indices of the oscillators given, those that live longest first
    oscillators : in that order
    lifetimes : (modes,) samples, in that order
    block : samples of a block
    """

    def __init__(
        self, oscillators: Oscillators, weights: tuple[Floats, Floats], samples: int, floor_db: float
    ) -> None:
        if not LOWEST_FLOOR_DB <= floor_db < 0:
            raise QueryError("floor_db", f"{floor_db} dB", f"Give {LOWEST_FLOOR_DB:g} to below 0.")
        lifetimes = oscillators.lifetimes(floor_db)
        self.order = np.argsort(-lifetimes, kind="stable")
        self.lifetimes = lifetimes[self.order]
        self.oscillators = oscillators.take(self.order)
        self.weights = (weights[0][self.order], weights[1][self.order])
        self.samples = samples
        # A multiple of 16 suits vector registers. It must not depend on the number of contacts, for then
        # the bits of a sound would.
        self.block = min(max(16, 16 * (math.isqrt(max(samples - 1, 0)) // 8)), LONGEST_BLOCK)
        self.fine = interleaved(*self.oscillators.basis(np.arange(self.block))).T.copy()

    def strike(
        self, amplitudes: Floats, sound: NDArray[np.floating], pulse_s: float | None, ahead: float
    ) -> None:
        """Write sounds (n, samples) of contacts that began `ahead` samples (below 1) before the first."""
        onset, coefficients = self.onset(amplitudes, pulse_s, ahead, sound.shape[1])
        during = onset.shape[1]
        sound[:, :during] = onset
        if during < sound.shape[1]:
            self.free(coefficients, sound[:, during:])

    def onset(
        self, amplitudes: Floats, pulse_s: float | None, ahead: float, most: int
    ) -> tuple[Floats, tuple[Floats, Floats]]:
        """Sounds (n, k) while the pulse lasts, k at most `most`, and coefficients (n, modes) at sample k."""
        if pulse_s is None:
            state = (np.zeros_like(amplitudes), amplitudes)
            return np.zeros((len(amplitudes), 0)), self.coefficients(state, ahead)
        response = HalfSine.of(self.oscillators, pulse_s)
        ends = pulse_s * self.oscillators.sample_rate_hz - ahead
        during = min(max(0, math.ceil(ends)), most)
        times = (np.arange(during) + ahead) / self.oscillators.sample_rate_hz
        onset = forced(response, self.weights, amplitudes, times)
        if during:
            free = np.empty_like(onset)
            start = (amplitudes * response.start[0], amplitudes * response.start[1])
            self.free(self.coefficients(start, ahead), free)
            onset += free
        state = (amplitudes * response.end[0], amplitudes * response.end[1])
        return onset, self.coefficients(state, max(0.0, during - ends))

    def coefficients(self, state: tuple[Floats, Floats], later: float) -> tuple[Floats, Floats]:
        """Coefficients (n, modes) some samples after displacements and velocities (n, modes)."""
        found = self.oscillators.coefficients(self.weights, *state)
        return self.oscillators.shifted(found, [later]) if later else found

    def free(self, coefficients: tuple[Floats, Floats], sound: NDArray[np.floating]) -> None:
        """Write the free motion (n, samples) from coefficients (n, modes) at the first sample."""
        first, second = (np.repeat(part, 2, axis=1) for part in coefficients)
        total = sound.shape[1]
        for start, stop, living in self.segments(total):
            if living == 0:
                sound[:, start:] = 0
                return
            blocks = -(-(stop - start) // self.block)
            modes = (
                self.oscillators if living == len(self.order) else self.oscillators.take(np.arange(living))
            )
            m0, m1, m2, m3 = modes.shift_matrix(modes.basis(start + self.block * np.arange(blocks)))
            of_first, of_second = interleaved(m0, m2), interleaved(m1, m3)
            fine = self.fine[: 2 * living, : stop - start]
            step = max(1, PRODUCT_NUMBERS // (blocks * 2 * living))
            rows = np.empty((min(step, len(sound)), blocks, 2 * living))
            part = np.empty_like(rows)
            for contact in range(0, len(sound), step):
                here = slice(contact, min(contact + step, len(sound)))
                count = here.stop - here.start
                np.multiply(first[here, None, : 2 * living], of_first, out=rows[:count])
                np.multiply(second[here, None, : 2 * living], of_second, out=part[:count])
                rows[:count] += part[:count]
                product = np.matmul(rows[:count], fine)
                sound[here, start:stop] = product.reshape(count, -1)[:, : stop - start]

    def segments(self, samples: int) -> Iterator[tuple[int, int, int]]:
        """Runs of blocks (start, stop, living modes) of `samples`; a run ends where an eighth has died."""
        start = 0
        while start < samples:
            living = int(np.searchsorted(-self.lifetimes, -start, side="left"))
            stop = samples
            if living:
                shortest = self.lifetimes[living - 1 - living // 8]
                if shortest < samples:
                    blocks = max(1, math.ceil((shortest - start) / self.block))
                    stop = min(stop, start + blocks * self.block)
                stop = min(stop, start + SEGMENT_BLOCKS * self.block)
            yield start, stop, living
            start = stop

    def work(self, samples: int, after: int = 0) -> float:
        """Share of the mode-samples from sample `after` on that are computed."""
        runs = ((max(start, after), stop, living) for start, stop, living in self.segments(samples))
        done = sum(max(0, stop - start) * living for start, stop, living in runs)
        return done / max(1, (samples - after) * len(self.order))


def forced(response: HalfSine, weights: tuple[Floats, Floats], amplitudes: Floats, times: Floats) -> Floats:
    """What a pulse adds to the free part while it lasts, (n, times), for amplitudes (n, modes)."""
    pulse = np.pi / response.duration_s
    sine, cosine = response.sinusoid
    # Sums along rows, and products of a row each, have the same bits whatever the other rows are.
    of_sine = (amplitudes * (weights[0] * sine - weights[1] * pulse * cosine)).sum(axis=1)
    of_cosine = (amplitudes * (weights[0] * cosine + weights[1] * pulse * sine)).sum(axis=1)
    phase = pulse * times
    added = of_sine[:, None] * np.sin(phase) + of_cosine[:, None] * np.cos(phase)
    if len(response.resonant):
        which = response.resonant
        displacement, velocity = response.resonance(times)
        table = weights[0][which] * displacement + weights[1][which] * velocity
        added += np.matmul(amplitudes[:, None, which], table.T)[:, 0]
    return added


def interleaved(first: Floats, second: Floats) -> Floats:
    """Two (n, modes) as one (n, 2 modes), mode by mode."""
    return np.stack([first, second], axis=2).reshape(len(first), -1)


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


def _durations(pulse_s: float | ArrayLike | None, contacts: int) -> Floats | None:
    """Return the duration of each pulse (contacts,), None for ideal impulses."""
    if pulse_s is None:
        return None
    given = np.asarray(pulse_s, dtype=np.float64)
    if given.shape not in ((), (1,), (contacts,)):
        raise QueryError("pulse_s", f"shape {given.shape} for {contacts} contacts", "Give one or one each.")
    if not (np.isfinite(given).all() and (given > 0).all()):
        raise QueryError("pulse_s", "not positive or not finite", "Give seconds; None for an ideal impulse.")
    return np.array(np.broadcast_to(given.reshape(-1), (contacts,)), dtype=np.float64)


def _groups(
    durations: Floats | None, contacts: int, most: int
) -> Iterator[tuple[slice | NDArray[np.int64], float | None]]:
    """Rows of contacts with pulses of one duration, at most `most` at a time."""
    if durations is None or len(durations) == 0 or (durations == durations[0]).all():
        count = contacts if durations is None else len(durations)
        common = None if durations is None or len(durations) == 0 else float(durations[0])
        for start in range(0, count, most):
            yield slice(start, min(start + most, count)), common
        return
    order = np.argsort(durations, kind="stable")
    borders = np.flatnonzero(np.diff(durations[order])) + 1
    for rows in np.split(order, borders):
        for start in range(0, len(rows), most):
            yield rows[start : start + most], float(durations[rows[0]])
