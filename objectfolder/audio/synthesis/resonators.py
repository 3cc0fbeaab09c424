"""A bank of resonators: the state of every mode, and the step that takes all of them on.

Free motion is the two coefficients of `Oscillators.basis` a mode. Sixty-four samples at a time are read off
them, then the coefficients move on by the exact matrix of 64 samples. Under a force that is linear over
each sample they move by one sample, and gain what the force does in it, in closed form. State that is kept is
a stream; a sound is a stream of one block. A mode is dropped when its lifetime has passed, long before its
numbers could become denormal.

What a contact pulse of half a sine does to an oscillator is in closed form. The force F(t) = J p(t), p(t) =
(pi / 2 T) sin(W t) with W = pi / T over 0 <= t <= T carries the impulse J. While it lasts the motion is a
sinusoid at W plus a free motion from t = 0; after it, a free motion from T. A mode whose pole lies close to
i W has both large and nearly opposite; there the convolution of the two exponentials is taken as one
divided difference, which has no small denominator.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.force_profile import ForceProfile
from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.audio.synthesis.ramps import held_steps, ramp_responses
from objectfolder.errors import QueryError
from objectfolder.jit import relaxed_kernel

Floats = NDArray[np.float64]
# |pole - i W| T below which a mode is resonant with the pulse; elsewhere the cancellation costs two digits.
RESONANT = 0.05


@dataclass(frozen=True)
class HalfSine:
    """Response of each mode to a half-sine of unit impulse; all arrays are (modes,).

    Attributes
    ----------
    duration_s : T
    start : displacement and velocity of the free part at t = 0; 0 for resonant modes
    sinusoid : displacement during the pulse is s sin(W t) + k cos(W t) + the free part; 0 for resonant modes
    end : displacement and velocity at T
    resonant : indices of the modes whose motion during the pulse `resonance` gives
    """

    oscillators: Oscillators
    duration_s: float
    start: tuple[Floats, Floats]
    sinusoid: tuple[Floats, Floats]
    end: tuple[Floats, Floats]
    resonant: NDArray[np.int64]

    @classmethod
    def of(cls, oscillators: Oscillators, duration_s: float) -> "HalfSine":
        """Solve for a pulse of a duration, seconds."""
        squares, damping = oscillators.eigenvalues, oscillators.dampings_per_s
        pulse = np.pi / duration_s
        force = np.pi / (2 * duration_s)
        gap = np.hypot(oscillators.roots_per_s - pulse, damping)
        resonant = np.flatnonzero((oscillators.discriminants > 0) & (gap * duration_s < RESONANT))
        detuning = squares - pulse**2
        denominator = detuning**2 + (2 * damping * pulse) ** 2
        denominator[resonant] = 1.0
        sine = force * detuning / denominator
        cosine = -force * 2 * damping * pulse / denominator
        sine[resonant], cosine[resonant] = 0.0, 0.0
        start = (-cosine, -sine * pulse)
        # sin(W T) = 0 and cos(W T) = -1
        at_end = free_motion(oscillators, start, duration_s)
        end = (at_end[0] - cosine, at_end[1] - sine * pulse)
        result = cls(oscillators, duration_s, start, (sine, cosine), end, resonant)
        if len(resonant):
            displacement, velocity = result.resonance(np.array([duration_s]))
            end[0][resonant], end[1][resonant] = displacement[0], velocity[0]
        return result

    def forced(self, weights: tuple[Floats, Floats], amplitudes: Floats, times: Floats) -> Floats:
        """What the pulse adds to the free part while it lasts, (n, times), for amplitudes (n, modes)."""
        pulse = np.pi / self.duration_s
        sine, cosine = self.sinusoid
        # Sums along rows, and products of a row each, have the same bits whatever the other rows are.
        of_sine = (amplitudes * (weights[0] * sine - weights[1] * pulse * cosine)).sum(axis=1)
        of_cosine = (amplitudes * (weights[0] * cosine + weights[1] * pulse * sine)).sum(axis=1)
        phase = pulse * times
        added = of_sine[:, None] * np.sin(phase) + of_cosine[:, None] * np.cos(phase)
        if len(self.resonant):
            which = self.resonant
            displacement, velocity = self.resonance(times)
            table = weights[0][which] * displacement + weights[1][which] * velocity
            added += np.matmul(amplitudes[:, None, which], table.T)[:, 0]
        return np.asarray(added)

    def resonance(self, times: Floats) -> tuple[Floats, Floats]:
        """Displacement and velocity (n, resonant modes) of those at times (n,) within the pulse.

        With s the pole, z(t) = integral of exp(s (t - u)) sin(W u) du has as its parts the integrals with
        exp(-c t) cos(w t) and exp(-c t) sin(w t).
        """
        modes = self.oscillators.take(self.resonant)
        root, damping = modes.roots_per_s, modes.dampings_per_s
        pulse = np.pi / self.duration_s
        t = times[:, None]
        pole = -damping + 1j * root
        z = (_convolved(pole, 1j * pulse, t) - _convolved(pole, -1j * pulse, t)) / 2j
        force = np.pi / (2 * self.duration_s)
        displacement = force * z.imag / root
        return displacement, force * z.real - damping * displacement


def free_motion(
    oscillators: Oscillators, state: tuple[Floats, Floats], time_s: float
) -> tuple[Floats, Floats]:
    """Displacement and velocity (modes,) a time after a state; shapes (modes,)."""
    offset = [time_s * oscillators.sample_rate_hz]
    basis = oscillators.basis(offset)
    moved = []
    for response in ("displacement", "velocity"):
        weights = oscillators.response_weights(response)
        a, b = oscillators.coefficients(weights, state[0], state[1])
        moved.append(np.asarray(a * basis[0][0] + b * basis[1][0]))
    return moved[0], moved[1]


def _convolved(a: NDArray[np.complex128], b: complex, t: Floats) -> NDArray[np.complex128]:
    """Integral over u from 0 to t of exp(a (t - u)) exp(b u)."""
    z = (b - a) * t
    safe = np.where(z == 0, 1.0, z)
    return np.asarray(np.exp(a * t) * t * np.where(z == 0, 1.0, np.expm1(safe) / safe))


LOWEST_FLOOR_DB = -600.0  # beyond, numbers would leave the range of full precision
RESONATORS_KEPT = 16
STRIDE = 64  # the kernel has it as a number


@dataclass(frozen=True)
class Resonators:
    """Oscillators with what one channel hears of them.

    Attributes
    ----------
    oscillators : those that live longest first
    weights : (modes,) of displacement and velocity in what is heard
    order : (modes,) their indices among the oscillators given to `of`
    lifetimes : (modes,) samples, descending
    table : (modes, 2, 64) the basis at 0 to 63 samples
    moves : (65, 4, modes) the matrix that moves coefficients on, by 0 to 64 samples
    """

    oscillators: Oscillators
    weights: tuple[Floats, Floats]
    order: NDArray[np.int64]
    lifetimes: Floats
    table: Floats
    moves: Floats

    @classmethod
    def of(cls, oscillators: Oscillators, weights: tuple[Floats, Floats], floor_db: float) -> "Resonators":
        """Return the resonators of oscillators that are dropped `floor_db` below their own start.

        Raises
        ------
        QueryError
            A floor outside of -600 to below 0.
        """
        if not LOWEST_FLOOR_DB <= floor_db < 0:
            raise QueryError("floor_db", f"{floor_db} dB", f"Give {LOWEST_FLOOR_DB:g} to below 0.")
        numbers = oscillators.eigenvalues, oscillators.dampings_per_s, *weights
        # A query asks for those of the one before it, as a rule.
        return _resonators(oscillators.sample_rate_hz, floor_db, *(row.tobytes() for row in numbers))

    def __len__(self) -> int:
        return len(self.order)

    def damped(self, added_per_s: Floats) -> "Resonators":
        """Return them with larger decay rates, by (modes,), and the same frequencies."""
        seconds = np.arange(STRIDE + 1)[:, None] / self.oscillators.sample_rate_hz
        left = np.exp(-added_per_s * seconds)
        table, moves = self.table * left[:STRIDE].T[:, None], self.moves * left[:, None]
        return replace(self, table=table, moves=moves)

    @cached_property
    def _ramps(self) -> dict[float, Floats]:
        """`held_steps` by their length."""
        return {}

    def coefficients(self, state: tuple[Floats, Floats], later: float) -> Floats:
        """Coefficients (n, 2, modes) some samples after displacements and velocities (n, modes)."""
        return self._later(state[0][:, None] * self._units[0] + state[1][:, None] * self._units[1], later)

    def _later(self, coefficients: Floats, samples: float) -> Floats:
        if not samples:
            return coefficients
        return np.stack(self.oscillators.shifted((coefficients[:, 0], coefficients[:, 1]), [samples]), axis=1)

    @cached_property
    def _units(self) -> Floats:
        """Coefficients (2, 2, modes) of a unit of displacement and of a unit of velocity."""
        ones, zeros = np.ones(len(self)), np.zeros(len(self))
        states = ((ones, zeros), (zeros, ones))
        return np.array([self.oscillators.coefficients(self.weights, *state) for state in states])

    def ring(self, coefficients: Floats, sound: Floats, begin: int = 0, age: float = 0.0) -> None:
        """Add free motion to `sound` (n, samples), and move `coefficients` (n, 2, modes) to its end.

        Parameters
        ----------
        begin
            Sample of `sound` at which the coefficients hold.
        age
            Number of samples since all modes sounded.
        """
        _ring(self.table, self.moves, self.lifetimes, coefficients, sound, begin, age)

    def drive(self, gains: Floats, forces_n: Floats, sound: Floats) -> Floats:
        """Add the motion (samples,) from rest under forces, and return coefficients (2, modes) at its end.

        Parameters
        ----------
        gains
            (directions, modes).
        forces_n
            (k, directions) at the samples, linear between them, to zero within a sample after the last.
        """
        padded = np.zeros((len(sound) + 1, forces_n.shape[1]))
        padded[: len(forces_n)] = forces_n[: len(padded)]
        kicks = [
            self.oscillators.coefficients(self.weights, *ramp) for ramp in ramp_responses(self.oscillators)
        ]
        coefficients = np.zeros((2, len(self)))
        _drive(
            self.table, self.moves, np.array(kicks), np.ascontiguousarray(gains), padded, coefficients, sound
        )
        return coefficients

    def onset(
        self, amplitudes: Floats, pulse: float | ForceProfile | None, ahead: float, most: int
    ) -> tuple[Floats, Floats]:
        """Sounds (n, k) while a pulse lasts, k at most `most`, and coefficients (n, 2, modes) at sample k.

        Parameters
        ----------
        amplitudes
            (n, modes) modal velocity that the whole impulse gives.
        pulse
            How it is spent: over the duration of a half-sine, by a profile, or at once if None.
        ahead
            Samples (below 1) by which it began before the first.
        """
        if pulse is None:
            return np.zeros((len(amplitudes), 0)), self._later(amplitudes[:, None] * self._units[1], ahead)
        lasting_s = pulse.duration_s if isinstance(pulse, ForceProfile) else pulse
        ends = lasting_s * self.oscillators.sample_rate_hz - ahead
        during = min(max(0, math.ceil(ends)), most)
        times = (np.arange(during) + ahead) / self.oscillators.sample_rate_hz
        if isinstance(pulse, ForceProfile):
            if pulse.step_s not in self._ramps:
                self._ramps[pulse.step_s] = held_steps(pulse.stepped(self.oscillators))
            heard, end = pulse.response(self.oscillators, self.weights, self._ramps[pulse.step_s], times)
            onset = amplitudes @ heard.T
        else:
            sine = HalfSine.of(self.oscillators, pulse)
            onset, end = sine.forced(self.weights, amplitudes, times), sine.end
            if during:
                start = (amplitudes * sine.start[0], amplitudes * sine.start[1])
                self.ring(self.coefficients(start, ahead), onset)
        state = (amplitudes * end[0], amplitudes * end[1])
        return onset, self.coefficients(state, max(0.0, during - ends))


@lru_cache(maxsize=RESONATORS_KEPT)
def _resonators(sample_rate_hz: float, floor_db: float, *rows: bytes) -> Resonators:
    """Return `Resonators.of` from the bytes of its arrays: eigenvalues, dampings and both weights."""
    eigenvalues, dampings, of_displacement, of_velocity = (np.frombuffer(row) for row in rows)
    oscillators = Oscillators(eigenvalues, dampings, sample_rate_hz)
    lifetimes = oscillators.lifetimes(floor_db)
    order = np.argsort(-lifetimes, kind="stable")
    modes = oscillators.take(order)
    basis = modes.basis(np.arange(STRIDE + 1))
    table = np.ascontiguousarray(np.array(basis)[:, :STRIDE].T.swapaxes(1, 2))
    moves = np.stack(modes.shift_matrix(basis), axis=1)
    weights = of_displacement[order], of_velocity[order]
    return Resonators(modes, weights, order, lifetimes[order], table, moves)


@relaxed_kernel
def _ring(
    table: Floats, moves: Floats, ends: Floats, coefficients: Floats, sound: Floats, begin: int, age: float
) -> None:
    """Add free motions to sounds (n, samples), from coefficients (n, 2, modes), which move to their end."""
    samples = sound.shape[1] - begin
    remainder = samples % 64
    for row in range(sound.shape[0]):
        a, b, out = coefficients[row, 0], coefficients[row, 1], sound[row, begin:]
        for low in range(0, len(a), 16):  # modes whose table fits the nearest cache
            high = min(low + 16, len(a))
            for k in range(0, samples, 64):
                while high > low and ends[high - 1] <= k + age:
                    high -= 1
                    a[high] = 0.0
                    b[high] = 0.0
                if high == low or k + 64 > samples:
                    break
                part = out[k : k + 64]
                j = low
                while j + 4 <= high:  # four modes for each time that a sample is read and written
                    x0, y0, x1, y1 = a[j], b[j], a[j + 1], b[j + 1]
                    x2, y2, x3, y3 = a[j + 2], b[j + 2], a[j + 3], b[j + 3]
                    four = table[j : j + 4]
                    for i in range(64):
                        part[i] += (
                            (four[0, 0, i] * x0 + four[0, 1, i] * y0)
                            + (four[1, 0, i] * x1 + four[1, 1, i] * y1)
                            + (four[2, 0, i] * x2 + four[2, 1, i] * y2)
                            + (four[3, 0, i] * x3 + four[3, 1, i] * y3)
                        )
                    j += 4
                while j < high:
                    x0, y0 = a[j], b[j]
                    for i in range(64):
                        part[i] += table[j, 0, i] * x0 + table[j, 1, i] * y0
                    j += 1
                for j in range(low, high):
                    x, y = a[j], b[j]
                    a[j] = moves[64, 0, j] * x + moves[64, 1, j] * y
                    b[j] = moves[64, 2, j] * x + moves[64, 3, j] * y
            for j in range(low, high):
                x, y = a[j], b[j]
                for i in range(remainder):
                    out[samples - remainder + i] += table[j, 0, i] * x + table[j, 1, i] * y
                a[j] = moves[remainder, 0, j] * x + moves[remainder, 1, j] * y
                b[j] = moves[remainder, 2, j] * x + moves[remainder, 3, j] * y


@relaxed_kernel
def _drive(
    table: Floats,
    moves: Floats,
    kicks: Floats,
    gains: Floats,
    forces: Floats,
    coefficients: Floats,
    sound: Floats,
) -> None:
    """Add to `sound` (samples,) the motion under forces (samples + 1, directions), from coefficients.

    Of `kicks` (2, 2, modes) the first falls from the force at a sample, the second rises to that at the next.
    """
    move, now_of_a, now_of_b = moves[1], table[:, 0, 0].copy(), table[:, 1, 0].copy()
    a, b = coefficients[0], coefficients[1]
    directions, modes = gains.shape
    force = np.zeros(modes)
    for d in range(directions):
        for j in range(modes):
            force[j] += gains[d, j] * forces[0, d]
    for k in range(len(sound)):
        total = 0.0
        for j in range(modes):
            x, y = a[j], b[j]
            total += now_of_a[j] * x + now_of_b[j] * y
            now = force[j]
            then = 0.0
            for d in range(directions):
                then += gains[d, j] * forces[k + 1, d]
            a[j] = move[0, j] * x + move[1, j] * y + kicks[0, 0, j] * now + kicks[1, 0, j] * then
            b[j] = move[2, j] * x + move[3, j] * y + kicks[0, 1, j] * now + kicks[1, 1, j] * then
            force[j] = then
        sound[k] += total
