"""ObjectFolder 2.0's AudioNet: from a position to the gain of every mode for unit forces along x, y and z.

Three perceptrons of (x, y, z) with one output a mode; frequencies and dampings are stored beside them. One
range scales the positions and one a branch the gains, over all modes together, as in the public inference
code. Not published, decided here: mean squared error of batches of 256 points drawn with replacement, a first
rate of 2e-3 (5e-4 ended 3.4 dB worse after 2000 steps on a mug) that falls to 5e-5, outputs that start at
their mean.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from torch import Tensor

from bench.rivals.published import Floats, Perceptrons, Training, UnitRange, fit, single

BATCH = 256
FIRST_RATE, LAST_RATE = 2e-3, 5e-5


@dataclass(frozen=True)
class GainsNetwork:
    """A fitted network.

    Attributes
    ----------
    network : the three perceptrons
    position_range, gain_range : scalings to [0, 1]; gains have one a branch
    modes : number of modes
    training : what the fit did
    """

    network: Perceptrons
    position_range: UnitRange
    gain_range: UnitRange
    modes: int
    training: Training

    @property
    def bytes(self) -> int:
        """Stored: weights in single precision, ranges, frequencies, dampings and radiation weights."""
        return 4 * self.network.weights + 8 * (2 + 6 + 3 * self.modes)

    def gains(self, points: ArrayLike) -> Floats:
        """Gains (n, 3, modes) float64, kg^-1/2, at points (n, 3) metres."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        return self.gain_range.from_unit(self.network.answers(self.position_range.to_unit(points)))


def fit_gains_network(points: ArrayLike, gains: ArrayLike, *, steps: int, seed: int) -> GainsNetwork:
    """Fit to gains (n, 3, modes), kg^-1/2, at points (n, 3), metres."""
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    gains = np.asarray(gains, dtype=np.float64)
    position_range, gain_range = UnitRange.of(points), UnitRange.of(gains, axis=(0, 2))
    inputs, targets = single(position_range.to_unit(points)), single(gain_range.to_unit(gains))

    def loss(network: Perceptrons, generator: np.random.Generator) -> Tensor:
        batch = generator.integers(len(points), size=BATCH)
        return (network(inputs[batch]) - targets[batch]).square().mean()

    network, training = fit(
        lambda: Perceptrons(3, targets.mean(dim=0).numpy()),
        loss,
        lambda step: FIRST_RATE * (LAST_RATE / FIRST_RATE) ** (step / max(steps, 1)),
        steps=steps,
        seed=seed,
    )
    return GainsNetwork(network, position_range, gain_range, gains.shape[2], training)
