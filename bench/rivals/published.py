"""The multi-layer perceptron of the ObjectFolder papers, and one fit for all of their networks.

Eight layers of 256 with ReLU; the input joins again before the sixth; the output is linear; coordinates come
with their sines and cosines at 1, 2, 4 .. 512 radians a unit; weights start by Xavier's uniform rule. So it
is in the authors' public inference code, which also carries a layer of 256 to 128 that nothing reads
(`UNREAD_PARAMETERS`); it is in their file sizes and not here. Training is not published: each network says
what was decided.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from objectfolder.errors import InputError

Floats = NDArray[np.float64]
DEPTH, WIDTH, JOINED = 8, 256, 5  # the input joins again at layer `JOINED`, counted from 0
OCTAVES = 10
UNREAD_PARAMETERS = WIDTH * 128 + 128
# Rows evaluated at once; 256 numbers each make 8 MB a layer.
CHUNK = 8192

Network = TypeVar("Network", bound=nn.Module)


def encode(values: Tensor, frequencies: int = OCTAVES) -> Tensor:
    """Values (..., d) with sines and cosines at 2^0 .. 2^(frequencies - 1), (..., d (1 + 2 frequencies))."""
    parts = [values]
    for octave in range(frequencies):
        angle = values * 2.0**octave
        parts += [angle.sin(), angle.cos()]
    return torch.cat(parts, dim=-1)


def single(values: NDArray[np.floating]) -> Tensor:
    """Return an array as a tensor in single precision."""
    return torch.as_tensor(values, dtype=torch.float32)


class Branch(nn.Module):
    """Encoded coordinates (n, inputs) to (n, outputs)."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        entering = [inputs, *[WIDTH + (inputs if layer == JOINED else 0) for layer in range(1, DEPTH)]]
        layers = [nn.Linear(size, WIDTH) for size in entering]
        self.hidden = nn.ModuleList(layers)
        self.output = nn.Linear(WIDTH, outputs)
        for layer in layers:
            nn.init.xavier_uniform_(layer.weight, gain=nn.init.calculate_gain("relu"))
            nn.init.zeros_(layer.bias)
        nn.init.xavier_uniform_(self.output.weight)
        nn.init.zeros_(self.output.bias)

    def forward(self, encoded: Tensor) -> Tensor:
        """Evaluate."""
        value = encoded
        for index, layer in enumerate(self.hidden):
            if index == JOINED:
                value = torch.cat([encoded, value], dim=-1)
            value = torch.relu(layer(value))
        return torch.as_tensor(self.output(value))


class Perceptrons(nn.Module):
    """Coordinates (n, dimensions) to (n, branches, outputs), a perceptron a branch.

    Parameters
    ----------
    dimensions, start
        Of the coordinates; and what it answers everywhere at first, (branches, outputs).
    """

    def __init__(self, dimensions: int, start: NDArray[np.floating]) -> None:
        super().__init__()
        branches = [Branch(dimensions * (1 + 2 * OCTAVES), start.shape[1]) for _ in start]
        self.branches = nn.ModuleList(branches)
        with torch.no_grad():
            for branch, value in zip(branches, start, strict=True):
                nn.init.zeros_(branch.output.weight)
                branch.output.bias.copy_(single(value))

    @property
    def weights(self) -> int:
        """Number of weights and biases."""
        return sum(parameter.numel() for parameter in self.parameters())

    def forward(self, coordinates: Tensor) -> Tensor:
        """Evaluate."""
        encoded = encode(coordinates)
        return torch.stack([branch(encoded) for branch in self.branches], dim=1)

    def answers(self, coordinates: NDArray[np.floating]) -> NDArray[np.float32]:
        """Evaluate in bounded memory, without gradients."""
        with torch.inference_mode():
            parts = [
                self(single(part)).numpy()
                for part in np.split(coordinates, range(CHUNK, len(coordinates), CHUNK))
            ]
        return np.concatenate(parts)


@dataclass(frozen=True)
class UnitRange:
    """Affine map of values to [0, 1].

    Attributes
    ----------
    lowest, extent : broadcastable against the values
    """

    lowest: Floats
    extent: Floats

    @classmethod
    def of(cls, values: NDArray[np.floating], axis: tuple[int, ...] | None = None) -> "UnitRange":
        """Range of `values` over `axis`; of constant values the extent is 1."""
        lowest = np.asarray(values.min(axis=axis, keepdims=True), dtype=np.float64)
        extent = np.asarray(values.max(axis=axis, keepdims=True), dtype=np.float64) - lowest
        return cls(lowest, np.where(extent > 0, extent, 1.0))

    def to_unit(self, values: NDArray[np.floating]) -> Floats:
        """Values in [0, 1] within the range."""
        return np.asarray((values - self.lowest) / self.extent, dtype=np.float64)

    def from_unit(self, values: NDArray[np.floating]) -> Floats:
        """Undo `to_unit`."""
        return np.asarray(values * self.extent + self.lowest, dtype=np.float64)


@dataclass(frozen=True)
class Training:
    """What a fit did.

    Attributes
    ----------
    losses : (steps,) float64 of each batch
    cpu_s : CPU seconds of this process
    """

    losses: Floats
    cpu_s: float

    @property
    def steps(self) -> int:
        """How many steps were taken."""
        return len(self.losses)


def fit(
    make: Callable[[], Network],
    loss: Callable[[Network, np.random.Generator], Tensor],
    rate: Callable[[int], float],
    *,
    steps: int | None = None,
    budget_cpu_s: float | None = None,
    seed: int = 0,
) -> tuple[Network, Training]:
    """Fit a network by Adam, on one thread.

    With `steps`, equal arguments give equal weights on one machine; with a budget the number of steps is what
    the time allowed.

    Parameters
    ----------
    make
        Makes the network; the seed decides its weights.
    loss
        Of the network on a batch that the generator draws; the seed and the number of the step decide it.
    rate
        Of a step, by its number.
    steps, budget_cpu_s
        How many, and CPU seconds of this process after which none begins; at least one.

    Raises
    ------
    InputError
        Neither steps nor a budget, or a negative one.
    """
    if (steps is None and budget_cpu_s is None) or (steps or 0) < 0 or (budget_cpu_s or 0) < 0:
        raise InputError(
            "network", f"steps {steps}, budget {budget_cpu_s} CPU s", "Give one that is not negative."
        )
    begin = time.process_time()
    losses: list[float] = []
    with one_thread(seed):
        network = make().train()
        optimiser = torch.optim.Adam(network.parameters())
        while (steps is None or len(losses) < steps) and (
            budget_cpu_s is None or time.process_time() - begin < budget_cpu_s
        ):
            for group in optimiser.param_groups:
                group["lr"] = rate(len(losses))
            optimiser.zero_grad(set_to_none=True)
            value = loss(network, np.random.default_rng([seed, len(losses)]))
            value.backward()
            optimiser.step()
            losses.append(float(value.item()))
    return network.eval(), Training(np.array(losses), time.process_time() - begin)


@contextmanager
def one_thread(seed: int) -> Iterator[None]:
    """One thread and seeded weights for the block, so that a seed gives the same network."""
    threads = torch.get_num_threads()
    state = torch.random.get_rng_state()
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.random.set_rng_state(state)
