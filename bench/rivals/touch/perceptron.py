"""The network both papers use for touch: a multi-layer perceptron of one pixel's coordinates.

It is `bench.rivals.published_perceptron`, on encoded coordinates.

Training is not published. Decided here: Adam at 5e-4, the rate of the papers' other networks; mean squared
error over pixels drawn evenly from all training touches; an output that starts at the targets' mean.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from bench.rivals.published_perceptron import OCTAVES, EncodedPerceptron, encode, one_thread
from objectfolder.errors import InputError

RATE = 5e-4
BATCH_PIXELS = 1024
# Pixels evaluated at once; 256 numbers each make 8 MB a layer.
CHUNK = 8192

Draw = Callable[[np.random.Generator, int], tuple[np.ndarray, np.ndarray]]


class Perceptron(EncodedPerceptron):
    """Coordinates (n, dimensions) to (n, outputs)."""

    def __init__(self, dimensions: int, outputs: int) -> None:
        super().__init__(dimensions * (1 + 2 * OCTAVES), outputs)

    @property
    def parameter_count(self) -> int:
        """Weights and biases."""
        return sum(parameter.numel() for parameter in self.parameters())

    def start_at(self, outputs: np.ndarray) -> None:
        """Answer `outputs` (outputs,) everywhere, whatever the hidden layers hold."""
        with torch.no_grad():
            nn.init.zeros_(self.output.weight)
            self.output.bias.copy_(torch.as_tensor(outputs, dtype=torch.float32))

    def forward(self, coordinates: Tensor) -> Tensor:
        """Evaluate."""
        return super().forward(encode(coordinates))

    def answers(self, coordinates: np.ndarray) -> np.ndarray:
        """Evaluate coordinates (n, dimensions) in bounded memory, without gradients: (n, outputs) float32."""
        device = self.output.bias.device
        with torch.inference_mode():
            parts = [
                self(torch.as_tensor(part, dtype=torch.float32, device=device)).cpu().numpy()
                for part in np.split(coordinates, range(CHUNK, len(coordinates), CHUNK))
            ]
        return np.concatenate(parts)


@dataclass(frozen=True)
class Training:
    """What a fit did.

    Attributes
    ----------
    steps, batch_pixels : of the optimiser
    losses : (steps,) float64, mean squared errors of the batches, in squares of the scaled output
    cpu_s : CPU seconds of this process
    device : where
    """

    steps: int
    batch_pixels: int
    losses: np.ndarray
    cpu_s: float
    device: str


def fit_perceptron(
    dimensions: int,
    start: np.ndarray,
    draw: Draw,
    *,
    steps: int | None = None,
    budget_cpu_s: float | None = None,
    batch_pixels: int = BATCH_PIXELS,
    seed: int = 0,
    device: str = "cpu",
) -> tuple[Perceptron, Training]:
    """Fit to pixels that `draw(generator, count)` gives: coordinates (count, d) and targets (count, outputs).

    One thread computes. Equal arguments with `steps` give equal weights on one machine; with a budget the
    number of steps is what the time allowed.

    Parameters
    ----------
    dimensions
        Of a pixel's coordinates.
    start
        (outputs,) what it answers everywhere at first.
    steps, budget_cpu_s
        Steps of the optimiser, and CPU seconds of this process after which none begins; at least one.
    batch_pixels
        Pixels a step.
    seed
        Of weights and draws.
    device
        Torch device.

    Raises
    ------
    InputError
        Neither steps nor a budget, or a negative one.
    """
    if (steps is None and budget_cpu_s is None) or (steps or 0) < 0 or (budget_cpu_s or 0) < 0:
        raise InputError(
            "touch network", f"steps {steps}, budget {budget_cpu_s} CPU s", "Give one that is not negative."
        )
    begin = time.process_time()
    place = torch.device(device)
    with one_thread(seed):
        network = Perceptron(dimensions, len(start))
        network.start_at(start)
        network.to(place).train()
        losses = _descend(network, draw, steps, budget_cpu_s, batch_pixels, seed, place)
    network.eval()
    spent = time.process_time() - begin
    return network, Training(len(losses), batch_pixels, np.array(losses), spent, device)


def _descend(
    network: Perceptron,
    draw: Draw,
    steps: int | None,
    budget_cpu_s: float | None,
    batch_pixels: int,
    seed: int,
    place: torch.device,
) -> list[float]:
    """Take steps up to their number or the budget; their losses."""
    start = time.process_time()
    optimiser = torch.optim.Adam(network.parameters(), lr=RATE)
    losses: list[float] = []
    while (steps is None or len(losses) < steps) and (
        budget_cpu_s is None or time.process_time() - start < budget_cpu_s
    ):
        coordinates, targets = (
            torch.as_tensor(part, dtype=torch.float32, device=place)
            for part in draw(np.random.default_rng([seed, len(losses)]), batch_pixels)
        )
        optimiser.zero_grad(set_to_none=True)
        loss = (network(coordinates) - targets).square().mean()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.item()))
    return losses


def pixel_grid(height: int, width: int, low: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows (height,) and columns (width,) of an image, each even from `low` to 1, first to last."""
    return np.linspace(low, 1.0, height), np.linspace(low, 1.0, width)
