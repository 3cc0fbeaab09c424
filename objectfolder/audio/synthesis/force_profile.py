"""A force of any course in time, held over short steps, and what it does to oscillators."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.jit import relaxed_kernel

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ForceProfile:
    """The course of a force whose impulse is 1 N s.

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

    def stepped(self, oscillators: Oscillators) -> Oscillators:
        """Return them with a sample a step."""
        return Oscillators(oscillators.eigenvalues, oscillators.dampings_per_s, 1 / self.step_s)

    def response(
        self, oscillators: Oscillators, weights: tuple[Floats, Floats], steps: Floats, times_s: Floats
    ) -> tuple[Floats, tuple[Floats, Floats]]:
        """Return what is heard of each mode during the force, and its state at the end.

        Parameters
        ----------
        oscillators, weights
            As for `Resonators`; each has a gain of 1.
        steps
            `held_steps` of `step_s`.
        times_s
            (n,) ascending, within the duration.

        Returns
        -------
        tuple
            (n, modes), and displacement and velocity (modes,).
        """
        modes = self.stepped(oscillators)
        within = np.minimum((times_s / self.step_s).astype(np.int64), len(self.forces_n) - 1)
        states = np.zeros((len(within) + 1, 2, len(modes)))
        _hold(steps, self.forces_n, np.append(within, len(self.forces_n)), states)
        # Under a force that is held a mode moves freely about another place of rest.
        rest = self.forces_n[within, None] / modes.eigenvalues
        first, second = modes.coefficients(weights, states[:-1, 0] - rest, states[:-1, 1])
        basis = modes.basis(times_s / self.step_s - within)
        heard = first * basis[0] + second * basis[1] + weights[0] * np.asarray(rest, dtype=np.float64)
        return heard, (states[-1, 0], states[-1, 1])


@relaxed_kernel
def _hold(steps: Floats, forces: Floats, moments: NDArray[np.int64], states: Floats) -> None:
    """Write states (n, 2, modes), from rest, at the beginning of steps `moments` (n,), ascending."""
    modes = steps.shape[1]
    q, v = np.zeros(modes), np.zeros(modes)
    written = 0
    for k in range(len(forces) + 1):
        while written < len(moments) and moments[written] == k:
            for j in range(modes):
                states[written, 0, j] = q[j]
                states[written, 1, j] = v[j]
            written += 1
        if k < len(forces):
            for j in range(modes):
                x, y = q[j], v[j]
                q[j] = steps[0, j] * x + steps[1, j] * y + steps[4, j] * forces[k]
                v[j] = steps[2, j] * x + steps[3, j] * y + steps[5, j] * forces[k]
