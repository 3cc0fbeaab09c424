"""The network both papers use for sound: one multi-layer perceptron for a unit force along each axis.

Three perceptrons of `bench.rivals.published_perceptron`, one an axis.

Training is not published. Decided here: Adam with a rate that falls to 5e-5, mean squared error of outputs
scaled to [0, 1] by the least and largest training value of each branch (the scaling is in the inference
code), and outputs that start at their mean or at silence: from Xavier's rule, hundreds of steps on
spectrograms end a hundred times further from the truth than silence is.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bench.rivals.published_perceptron import OCTAVES, EncodedPerceptron, encode

AXES = 3
LAST_RATE = 5e-5

Batch = tuple[Tensor, Tensor, Tensor]


class Branches(nn.Module):
    """Three perceptrons on the same coordinates (n, d): (n, 3, outputs), axis by axis of the unit force."""

    def __init__(self, dimensions: int, outputs: int) -> None:
        super().__init__()
        inputs = dimensions * (1 + 2 * OCTAVES)
        branches = [EncodedPerceptron(inputs, outputs) for _ in range(AXES)]
        self.axes = nn.ModuleList(branches)
        self._outputs = [branch.output for branch in branches]

    @property
    def weights(self) -> int:
        """Number of weights and biases."""
        return sum(parameter.numel() for parameter in self.parameters())

    @property
    def device(self) -> torch.device:
        """Where the weights are."""
        return next(self.parameters()).device

    def start_at(self, outputs: Tensor) -> None:
        """Answer `outputs` (3, outputs) everywhere, whatever the hidden layers hold."""
        with torch.no_grad():
            for layer, value in zip(self._outputs, outputs, strict=True):
                nn.init.zeros_(layer.weight)
                layer.bias.copy_(value)

    def forward(self, coordinates: Tensor) -> Tensor:
        """Evaluate."""
        encoded = encode(coordinates)
        return torch.stack([branch(encoded) for branch in self.axes], dim=1)


@dataclass(frozen=True)
class Training:
    """What a fit did.

    Attributes
    ----------
    steps : of the optimiser
    losses : (steps,) float64 of each batch, in squares of the scaled output
    cpu_s : CPU seconds of this process
    """

    steps: int
    losses: NDArray[np.float64]
    cpu_s: float


def train(
    network: Branches,
    batches: Callable[[int], Iterator[Batch]],
    steps: int,
    first_rate: float,
    device: torch.device,
) -> Training:
    """Fit to batches of coordinates (n, d), targets (n, 3, outputs) and weights (n,) of mean 1."""
    start = time.process_time()
    network.to(device).train()
    optimiser = torch.optim.Adam(network.parameters(), lr=first_rate)
    fall = (LAST_RATE / first_rate) ** (1 / max(steps, 1))
    schedule = torch.optim.lr_scheduler.ExponentialLR(optimiser, fall)
    losses = np.zeros(steps)
    for step, (coordinates, targets, weights) in enumerate(batches(steps)):
        optimiser.zero_grad()
        squares = (network(coordinates) - targets).square().mean(dim=(1, 2))
        loss = (squares * weights).mean()
        loss.backward()
        optimiser.step()
        schedule.step()
        losses[step] = loss.item()
    network.eval()
    return Training(steps, losses, time.process_time() - start)


@dataclass(frozen=True)
class UnitRange:
    """Affine map of values to [0, 1].

    Attributes
    ----------
    lowest, extent : broadcastable against the values
    """

    lowest: NDArray[np.float64]
    extent: NDArray[np.float64]

    @classmethod
    def of(cls, values: NDArray[np.floating], axis: tuple[int, ...] | None = None) -> "UnitRange":
        """Range of `values` over `axis`; of constant values the extent is 1."""
        lowest = np.asarray(values.min(axis=axis, keepdims=True), dtype=np.float64)
        extent = np.asarray(values.max(axis=axis, keepdims=True), dtype=np.float64) - lowest
        return cls(lowest, np.where(extent > 0, extent, 1.0))

    def to_unit(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Values in [0, 1] within the range."""
        return np.asarray((values - self.lowest) / self.extent, dtype=np.float64)

    def from_unit(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Undo `to_unit`."""
        return np.asarray(values * self.extent + self.lowest, dtype=np.float64)


def stored_bytes(network: Branches, numbers: int) -> int:
    """Bytes of the weights in single precision and of `numbers` other numbers in double precision."""
    return 4 * network.weights + 8 * numbers
