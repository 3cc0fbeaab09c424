"""A bank of resonators: the state of every mode, and the step that takes all of them on.

Free motion is the state of each mode, displacement and velocity. Sixty-four samples at a time are read off
it, then it moves on by the exact propagator of 64 samples. Under a force that is linear over each sample it
moves by one sample, and gains what the force does in it, in closed form. State that is kept is a stream; a
sound is a stream of one block. A mode is dropped when its lifetime has passed, long before its numbers could
become denormal.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.synthesis.oscillators import Oscillators, moved
from objectfolder.audio.synthesis.pulses import Course
from objectfolder.errors import QueryError
from objectfolder.jit import relaxed_kernel

Floats = NDArray[np.float64]
FLOOR_DB = -220.0
LOWEST_FLOOR_DB = -600.0  # beyond, numbers would leave the range of full precision
RESONATORS_KEPT = 16
STRIDE = 64  # the kernel has it as a number
ONSET_STATES = 1 << 12  # samples of an onset computed at once


@dataclass(frozen=True)
class Resonators:
    """Oscillators with what one channel hears of them.

    Attributes
    ----------
    oscillators : those that live longest first
    weights : (2, modes) of displacement and velocity in what is heard
    columns : (modes,) which amplitudes are theirs, of the `width` of a contact
    width : modes of a contact, those that are not heard included
    lifetimes : (modes,) samples, descending
    table : (modes, 2, 64) what is heard at 0 to 63 samples of a unit of displacement and of velocity
    moves : (65, 4, modes) propagators by 0 to 64 samples
    """

    oscillators: Oscillators
    weights: Floats
    columns: NDArray[np.int64]
    width: int
    lifetimes: Floats
    table: Floats
    moves: Floats

    @classmethod
    def of(
        cls,
        oscillators: Oscillators,
        weights: tuple[Floats, Floats],
        columns: NDArray[np.int64] | None = None,
        width: int | None = None,
        floor_db: float = FLOOR_DB,
    ) -> "Resonators":
        """Return the resonators of oscillators that are dropped `floor_db` below their own start.

        Parameters
        ----------
        columns, width
            Of all modes of a contact those that sound, and their number; all by default.

        Raises
        ------
        QueryError
            A floor outside of -600 to below 0.
        """
        if not LOWEST_FLOOR_DB <= floor_db < 0:
            raise QueryError("floor_db", f"{floor_db} dB", f"Give {LOWEST_FLOOR_DB:g} to below 0.")
        columns = np.arange(len(oscillators)) if columns is None else columns
        rows = oscillators.eigenvalues, oscillators.dampings_per_s, *weights, columns
        width = len(oscillators) if width is None else width
        # A query asks for those of the one before it, as a rule.
        return _resonators(oscillators.sample_rate_hz, floor_db, width, *(row.tobytes() for row in rows))

    @classmethod
    def of_modes(
        cls,
        eigenvalues: ArrayLike,
        dampings_per_s: ArrayLike,
        sample_rate_hz: float,
        response: str,
        floor_db: float,
        factors: Floats | float = 1.0,
    ) -> "Resonators":
        """Return the modes that do not alias, heard by their response times factors (modes,).

        Raises
        ------
        QueryError
            As for `mode_bank`.
        """
        oscillators = Oscillators.checked(eigenvalues, dampings_per_s, sample_rate_hz)
        displacement, velocity = oscillators.response_weights(response)
        columns = np.flatnonzero(oscillators.audible())
        weights = (displacement * factors)[columns], (velocity * factors)[columns]
        return cls.of(oscillators.take(columns), weights, columns, len(oscillators), floor_db)

    def __len__(self) -> int:
        return len(self.columns)

    def damped(self, added_per_s: Floats) -> "Resonators":
        """Return them with larger decay rates, by (modes,), and the same frequencies."""
        seconds = np.arange(STRIDE + 1)[:, None] / self.oscillators.sample_rate_hz
        left = np.exp(-added_per_s * seconds)
        table, moves = self.table * left[:STRIDE].T[:, None], self.moves * left[:, None]
        return replace(self, table=table, moves=moves)

    def ring(self, states: Floats, sound: Floats, begin: int = 0, age: float = 0.0) -> None:
        """Add free motion to `sound` (n, samples), and move `states` (n, 2, modes) to its end.

        Parameters
        ----------
        begin
            Sample of `sound` at which the states hold.
        age
            Number of samples since all modes sounded.
        """
        _ring(self.table, self.moves, self.lifetimes, states, sound, begin, age)

    def drive(self, gains: Floats, forces_n: Floats, most: int) -> tuple[Floats, Floats]:
        """Sound (1, k) under forces from rest, k at most `most`, and the state (1, 2, modes) at sample k.

        Parameters
        ----------
        gains
            (directions, modes).
        forces_n
            (k, directions) at the samples, linear between them, to zero within a sample after the last.
        """
        sound, state = np.zeros((1, min(len(forces_n), most))), np.zeros((1, 2, len(self)))
        padded = np.concatenate([forces_n, np.zeros((1, forces_n.shape[1]))])
        ramps = self.oscillators.ramps
        _drive(self.moves[1], self.weights, ramps, np.ascontiguousarray(gains), padded, state[0], sound[0])
        return sound, state

    def onset(self, amplitudes: Floats, course: Course, ahead: float, most: int) -> tuple[Floats, Floats]:
        """Sounds (n, k) while a force lasts, k at most `most`, and states (n, 2, modes) at sample k.

        Parameters
        ----------
        amplitudes
            (n, modes) modal velocity that the whole impulse gives.
        course
            How it is spent.
        ahead
            Samples (below 1) by which it began before the first.
        """
        rate_hz, modes = self.oscillators.sample_rate_hz, self.oscillators
        if course is None:
            states = np.zeros((len(amplitudes), 2, len(self)))
            states[:, 1] = amplitudes
            return amplitudes[:, :0], moved(modes.propagator([ahead])[0], states) if ahead else states
        lasting = course.duration_s * rate_hz
        during = min(max(0, math.ceil(lasting - ahead)), most)
        sound = np.empty((len(amplitudes), during))
        for start in range(0, max(during, 1), ONSET_STATES):
            samples = np.arange(start, min(start + ONSET_STATES, during))
            times_s = np.append((samples + ahead) / rate_hz, course.duration_s)
            states, free = course.motion(modes, times_s)
            heard = np.einsum("im,nim->mn", self.weights, states[:-1])
            # Row by row: a row has the same bits whatever the others are.
            for row, amplitude in zip(sound, amplitudes, strict=True):
                row[samples] = amplitude @ heard
        to_sample, to_end, after = modes.propagator([ahead, lasting, max(0.0, during + ahead - lasting)])
        self.ring(amplitudes[:, None] * moved(to_sample, free), sound)
        return sound, amplitudes[:, None] * moved(after, states[-1] + moved(to_end, free))


@lru_cache(maxsize=RESONATORS_KEPT)
def _resonators(sample_rate_hz: float, floor_db: float, width: int, *rows: bytes) -> Resonators:
    """Return `Resonators.of` from the bytes of eigenvalues, dampings, both weights and columns."""
    eigenvalues, dampings, of_displacement, of_velocity = (np.frombuffer(row) for row in rows[:4])
    oscillators = Oscillators(eigenvalues, dampings, sample_rate_hz)
    lifetimes = oscillators.lifetimes(floor_db)
    order = np.argsort(-lifetimes, kind="stable")
    modes, weights = oscillators.take(order), np.array([of_displacement, of_velocity]).take(order, axis=1)
    moves = modes.propagator(np.arange(STRIDE + 1))
    table = np.einsum("im,nijm->mjn", weights, moves[:STRIDE])
    moves = moves.reshape(STRIDE + 1, 4, len(modes))
    columns, table = np.frombuffer(rows[4], dtype=np.int64)[order], np.ascontiguousarray(table)
    return Resonators(modes, weights, columns, width, lifetimes[order], table, moves)


@relaxed_kernel
def _ring(
    table: Floats, moves: Floats, ends: Floats, states: Floats, sound: Floats, begin: int, age: float
) -> None:
    """Add free motions to sounds (n, samples), from states (n, 2, modes), which move to their end."""
    samples, modes = sound.shape[1] - begin, states.shape[2]
    for row in range(len(sound)):
        q, v, out = states[row, 0], states[row, 1], sound[row, begin:]
        for low in range(0, modes, 16):  # modes whose table fits the nearest cache
            high = min(low + 16, modes)
            for k in range(0, samples, 64):
                while high > low and ends[high - 1] <= k + age:
                    high -= 1
                    q[high] = v[high] = 0.0
                if high == low:
                    break
                heard = min(64, samples - k)
                part = out[k : k + 64] if heard == 64 else np.zeros(64)
                fours = low + (high - low) // 4 * 4
                for j in range(low, fours, 4):  # four modes for each time that a sample is read and written
                    x0, y0, x1, y1 = q[j], v[j], q[j + 1], v[j + 1]
                    x2, y2, x3, y3 = q[j + 2], v[j + 2], q[j + 3], v[j + 3]
                    four = table[j : j + 4]
                    for i in range(64):
                        part[i] += (
                            (four[0, 0, i] * x0 + four[0, 1, i] * y0)
                            + (four[1, 0, i] * x1 + four[1, 1, i] * y1)
                            + (four[2, 0, i] * x2 + four[2, 1, i] * y2)
                            + (four[3, 0, i] * x3 + four[3, 1, i] * y3)
                        )
                for j in range(fours, high):
                    x0, y0 = q[j], v[j]
                    for i in range(64):
                        part[i] += table[j, 0, i] * x0 + table[j, 1, i] * y0
                if heard < 64:
                    out[k:] += part[:heard]
                for j in range(low, high):
                    x0, y0 = q[j], v[j]
                    q[j] = moves[heard, 0, j] * x0 + moves[heard, 1, j] * y0
                    v[j] = moves[heard, 2, j] * x0 + moves[heard, 3, j] * y0


@relaxed_kernel
def _drive(
    move: Floats, weights: Floats, ramps: Floats, gains: Floats, forces: Floats, state: Floats, sound: Floats
) -> None:
    """Add to `sound` (samples,) the motion under forces (more samples, directions), and move the state.

    Of `ramps` (2, 2, modes) the first falls from the force at a sample, the second rises to that at the next.
    """
    q, v = state[0], state[1]
    directions, modes = gains.shape
    force = np.zeros(modes)
    for d in range(directions):
        for j in range(modes):
            force[j] += gains[d, j] * forces[0, d]
    for k in range(len(sound)):
        total = 0.0
        for j in range(modes):
            x, y, now, then = q[j], v[j], force[j], 0.0
            total += weights[0, j] * x + weights[1, j] * y
            for d in range(directions):
                then += gains[d, j] * forces[k + 1, d]
            q[j] = move[0, j] * x + move[1, j] * y + ramps[0, 0, j] * now + ramps[1, 0, j] * then
            v[j] = move[2, j] * x + move[3, j] * y + ramps[0, 1, j] * now + ramps[1, 1, j] * then
            force[j] = then
        sound[k] += total
