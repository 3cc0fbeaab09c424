"""ObjectFolder 2.0's AudioNet: from a position to the gain of every mode for unit forces along x, y and z.

Three perceptrons of (x, y, z) with one output a mode; frequencies and dampings are stored beside them. One
range scales the positions and one a branch the gains, over all modes together, as in the public inference
code. Not published, decided here: batches of 256 points drawn with replacement, a first rate of 2e-3 (5e-4
ended 3.4 dB worse after 2000 steps on a mug), see also `branches`.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from bench.rivals.audio.branches import (
    Batch,
    Branches,
    Training,
    UnitRange,
    stored_bytes,
    train,
)
from bench.rivals.published_perceptron import one_thread

Floats = NDArray[np.float64]
BATCH = 256
FIRST_RATE = 2e-3


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

    network: Branches
    position_range: UnitRange
    gain_range: UnitRange
    modes: int
    training: Training

    @property
    def bytes(self) -> int:
        """Stored: weights in single precision, ranges, frequencies, dampings and radiation weights."""
        return stored_bytes(self.network, 2 + 6 + 3 * self.modes)

    def gains(self, points: ArrayLike) -> Floats:
        """Gains (n, 3, modes) float64, kg^-1/2, at points (n, 3) metres."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        device = self.network.device
        with torch.no_grad():
            inputs = torch.as_tensor(self.position_range.to_unit(points), dtype=torch.float32, device=device)
            answer = self.network(inputs).cpu().numpy()
        return self.gain_range.from_unit(answer)


def fit_gains_network(
    points: ArrayLike,
    gains: ArrayLike,
    *,
    steps: int,
    seed: int,
    device: str = "cpu",
) -> GainsNetwork:
    """Fit to gains (n, 3, modes), kg^-1/2, at points (n, 3), metres.

    On the CPU it takes one thread, and a seed gives the same network.
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    gains = np.asarray(gains, dtype=np.float64)
    position_range = UnitRange.of(points)
    gain_range = UnitRange.of(gains, axis=(0, 2))
    place = torch.device(device)
    inputs = torch.as_tensor(position_range.to_unit(points), dtype=torch.float32, device=place)
    targets = torch.as_tensor(gain_range.to_unit(gains), dtype=torch.float32, device=place)
    generator = np.random.default_rng(seed)
    even = torch.ones(BATCH, device=place)

    def batches(count: int) -> Iterator[Batch]:
        for _ in range(count):
            chosen = torch.as_tensor(generator.integers(len(points), size=BATCH), device=place)
            yield inputs[chosen], targets[chosen], even

    with one_thread(seed):
        network = Branches(3, gains.shape[2])
        network.start_at(targets.mean(dim=0).cpu())
        training = train(network, batches, steps, FIRST_RATE, place)
    return GainsNetwork(network, position_range, gain_range, gains.shape[2], training)
