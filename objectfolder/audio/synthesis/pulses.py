"""Courses of a contact's force whose impulse is 1 N s, and the states in which they leave oscillators."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.oscillators import Oscillators, moved
from objectfolder.errors import QueryError
from objectfolder.jit import relaxed_kernel

Floats = NDArray[np.float64]
# |pole - i W| T below which a mode is resonant with the pulse; elsewhere the cancellation costs two digits.
RESONANT = 0.05
RESONANT_TERMS = 36  # of its series: what is left out is below 1e-18


@dataclass(frozen=True)
class HalfSine:
    """The force p(t) = (pi / 2 T) sin(W t), W = pi / T, over a time T.

    While it lasts a mode's motion is a sinusoid at W plus a free motion from t = 0. A mode whose pole lies
    close to i W has both large and nearly opposite; its motion is then a series without small denominators.
    """

    duration_s: float

    def __post_init__(self) -> None:
        if not 0 < self.duration_s < np.inf:
            finding = f"not positive or not finite: {self.duration_s} s"
            raise QueryError("pulse_s", finding, "Give seconds; None for an ideal impulse.")

    def motion(self, oscillators: Oscillators, times_s: Floats) -> tuple[Floats, Floats]:
        """Return forced states (n, 2, modes) at times (n,) within it.

        To them belongs a free motion, of which the state (2, modes) at t = 0 is returned, too.
        """
        squares, damping = oscillators.eigenvalues, oscillators.dampings_per_s
        angular, size = np.pi / self.duration_s, np.pi / (2 * self.duration_s)
        gap = np.hypot(oscillators.roots_per_s - angular, damping)
        resonant = (oscillators.discriminants > 0) & (gap * self.duration_s < RESONANT)
        detuning, viscous = squares - angular**2, 2 * damping * angular
        strength = np.where(resonant, 0.0, size / np.where(resonant, 1.0, detuning**2 + viscous**2))
        at_sine = strength * np.array([detuning, angular * viscous])
        at_cosine = strength * np.array([-viscous, angular * detuning])
        phases = angular * times_s[:, None, None]
        states = np.sin(phases) * at_sine + np.cos(phases) * at_cosine
        if resonant.any():
            cycle = np.array([0.0, 1.0, 0.0, -1.0])[np.arange(RESONANT_TERMS) % 4]
            pushes = size * cycle * np.pi ** np.arange(RESONANT_TERMS)
            shares = times_s / self.duration_s
            states[:, :, resonant] = oscillators.take(resonant).series(self.duration_s, pushes, shares)
        return states, -at_cosine


@dataclass(frozen=True)
class ForceProfile:
    """A force of any course in time, held over short steps.

    Attributes
    ----------
    step_s : over which the force is held
    forces_n : (k,) newtons, one after the other
    """

    step_s: float
    forces_n: Floats

    @property
    def duration_s(self) -> float:
        """Of all steps."""
        return self.step_s * len(self.forces_n)

    def motion(self, oscillators: Oscillators, times_s: Floats) -> tuple[Floats, Floats]:
        """Return what `HalfSine.motion` does, at ascending times; no free motion belongs to it."""
        modes = oscillators.at_rate(1 / self.step_s)
        steps = times_s / self.step_s
        within = np.minimum(steps.astype(np.int64), len(self.forces_n) - 1)
        states = np.zeros((len(within), 2, len(modes)))
        _hold(modes.held_steps, self.forces_n, within, states)
        # Under a force that is held a mode moves freely about another place of rest.
        rest = np.zeros_like(states)
        rest[:, 0] = self.forces_n[within, None] / modes.eigenvalues
        return moved(modes.propagator(steps - within), states - rest) + rest, np.zeros_like(states[0])


Course = HalfSine | ForceProfile | None  # of a force; None: all at once


def course_of(pulse: float | Course) -> Course:
    """Return the half-sine of a duration in seconds, and a course as it is."""
    return HalfSine(float(pulse)) if isinstance(pulse, int | float) else pulse


@relaxed_kernel
def _hold(steps: Floats, forces: Floats, moments: NDArray[np.int64], states: Floats) -> None:
    """Write states (n, 2, modes), from rest, at the beginning of steps `moments` (n,), ascending."""
    modes, begin = steps.shape[1], 0
    q, v = np.zeros(modes), np.zeros(modes)
    for row in range(len(moments)):
        for k in range(begin, moments[row]):
            for j in range(modes):
                x, y = q[j], v[j]
                q[j] = steps[0, j] * x + steps[1, j] * y + steps[4, j] * forces[k]
                v[j] = steps[2, j] * x + steps[3, j] * y + steps[5, j] * forces[k]
        begin = moments[row]
        for j in range(modes):
            states[row, 0, j], states[row, 1, j] = q[j], v[j]
