"""A contact pulse of half a sine, and what it does to an oscillator, in closed form.

The force F(t) = J p(t), p(t) = (pi / 2 T) sin(W t) with W = pi / T over 0 <= t <= T carries the impulse J.
While it lasts the motion is a sinusoid at W plus a free motion from t = 0; after it, a free motion from T.
A mode whose pole lies close to i W has both large and nearly opposite; there the convolution of the two
exponentials is taken as one divided difference, which has no small denominator.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.oscillators import Oscillators

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
