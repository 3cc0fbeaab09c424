"""A bank of resonators: the state of every mode, and the step that takes all of them on.

Free motion is the two coefficients of `Oscillators.basis` a mode. Sixteen samples at a time are read off
them, then the coefficients move on by the exact matrix of sixteen samples. Under a force that is linear over
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
from dataclasses import dataclass
from functools import cached_property

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
STRIDE = 16


@dataclass(frozen=True)
class Resonators:
    """Oscillators with what one channel hears of them.

    Attributes
    ----------
    oscillators : those that live longest first
    weights : (modes,) of displacement and velocity in what is heard
    order : (modes,) their indices among the oscillators given to `of`
    lifetimes : (modes,) samples, descending
    steps : (5, 17, modes), for 0 to 16 samples: the basis, and the second to fourth entry of the matrix that
        moves coefficients on; its first is that of the basis
    """

    oscillators: Oscillators
    weights: tuple[Floats, Floats]
    order: NDArray[np.int64]
    lifetimes: Floats
    steps: Floats

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
        lifetimes = oscillators.lifetimes(floor_db)
        order = np.argsort(-lifetimes, kind="stable")
        modes = oscillators.take(order)
        basis = modes.basis(np.arange(STRIDE + 1))
        steps = np.stack([*basis, *modes.shift_matrix(basis)[1:]])
        return cls(modes, (weights[0][order], weights[1][order]), order, lifetimes[order], steps)

    def __len__(self) -> int:
        return len(self.order)

    def damped(self, added_per_s: Floats) -> "Resonators":
        """Return them with larger decay rates, by (modes,), and the same frequencies."""
        seconds = np.arange(STRIDE + 1)[:, None] / self.oscillators.sample_rate_hz
        steps = self.steps * np.exp(-added_per_s * seconds)
        return Resonators(self.oscillators, self.weights, self.order, self.lifetimes, steps)

    @cached_property
    def _ramps(self) -> dict[float, Floats]:
        """`held_steps` by their length."""
        return {}

    def coefficients(self, state: tuple[Floats, Floats], later: float) -> Floats:
        """Coefficients (n, 2, modes) some samples after displacements and velocities (n, modes)."""
        first = self.oscillators.coefficients(self.weights, *state)
        return np.stack(self.oscillators.shifted(first, [later]) if later else first, axis=1)

    def ring(self, coefficients: Floats, sound: Floats, begin: int = 0, age: float = 0.0) -> None:
        """Add free motion to `sound` (n, samples), and move `coefficients` (n, 2, modes) to its end.

        Parameters
        ----------
        begin
            Sample of `sound` at which the coefficients hold.
        age
            Number of samples since all modes sounded.
        """
        _ring(self.steps, self.lifetimes - age, coefficients, sound, begin)

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
        _drive(self.steps, np.array(kicks), np.ascontiguousarray(gains), padded, coefficients, sound)
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
            state = (np.zeros_like(amplitudes), amplitudes)
            return np.zeros((len(amplitudes), 0)), self.coefficients(state, ahead)
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


@relaxed_kernel
def _ring(steps: Floats, ends: Floats, coefficients: Floats, sound: Floats, begin: int) -> None:
    """Add free motions to sounds (n, samples), from coefficients (n, 2, modes), which move to their end."""
    first, second, upper, lower, last = steps[0], steps[1], steps[2], steps[3], steps[4]
    samples = sound.shape[1] - begin
    remainder = samples % 16
    for row in range(sound.shape[0]):
        a, b, out = coefficients[row, 0], coefficients[row, 1], sound[row, begin:]
        for low in range(0, len(a), 64):  # modes whose steps fit the nearest cache
            high = min(low + 64, len(a))
            for k in range(0, samples - 15, 16):
                while k % 64 == 0 and high > low and ends[high - 1] <= k:
                    high -= 1
                    a[high] = 0.0
                    b[high] = 0.0
                if high == low:
                    break
                for half in range(0, 16, 8):  # sums of eight samples fill the vector registers
                    t0 = t1 = t2 = t3 = t4 = t5 = t6 = t7 = 0.0
                    for j in range(low, high):
                        x, y = a[j], b[j]
                        t0 += first[half, j] * x + second[half, j] * y
                        t1 += first[half + 1, j] * x + second[half + 1, j] * y
                        t2 += first[half + 2, j] * x + second[half + 2, j] * y
                        t3 += first[half + 3, j] * x + second[half + 3, j] * y
                        t4 += first[half + 4, j] * x + second[half + 4, j] * y
                        t5 += first[half + 5, j] * x + second[half + 5, j] * y
                        t6 += first[half + 6, j] * x + second[half + 6, j] * y
                        t7 += first[half + 7, j] * x + second[half + 7, j] * y
                    out[k + half] += t0
                    out[k + half + 1] += t1
                    out[k + half + 2] += t2
                    out[k + half + 3] += t3
                    out[k + half + 4] += t4
                    out[k + half + 5] += t5
                    out[k + half + 6] += t6
                    out[k + half + 7] += t7
                # A loop of its own: vector registers need stores apart from sums.
                for j in range(low, high):
                    x, y = a[j], b[j]
                    a[j] = first[16, j] * x + upper[16, j] * y
                    b[j] = lower[16, j] * x + last[16, j] * y
            for i in range(remainder):
                total = 0.0
                for j in range(low, high):
                    total += first[i, j] * a[j] + second[i, j] * b[j]
                out[samples - remainder + i] += total
            for j in range(low, high):
                x, y = a[j], b[j]
                a[j] = first[remainder, j] * x + upper[remainder, j] * y
                b[j] = lower[remainder, j] * x + last[remainder, j] * y


@relaxed_kernel
def _drive(
    steps: Floats, kicks: Floats, gains: Floats, forces: Floats, coefficients: Floats, sound: Floats
) -> None:
    """Add to `sound` (samples,) the motion under forces (samples + 1, directions), from coefficients.

    Of `kicks` (2, 2, modes) the first falls from the force at a sample, the second rises to that at the next.
    """
    first, second, upper, lower, last = steps[0], steps[1], steps[2], steps[3], steps[4]
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
            total += first[0, j] * x + second[0, j] * y
            now = force[j]
            then = 0.0
            for d in range(directions):
                then += gains[d, j] * forces[k + 1, d]
            a[j] = first[1, j] * x + upper[1, j] * y + kicks[0, 0, j] * now + kicks[1, 0, j] * then
            b[j] = lower[1, j] * x + last[1, j] * y + kicks[0, 1, j] * now + kicks[1, 1, j] * then
            force[j] = then
        sound[k] += total
