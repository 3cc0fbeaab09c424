"""The multi-layer perceptron of the ObjectFolder papers, which their networks for sound and touch share.

Eight layers of 256 with ReLU; the input joins again before the sixth; the output is linear; coordinates come
with their sines and cosines at 1, 2, 4 .. 512 radians a unit; weights start by Xavier's uniform rule. So it
is in the authors' public inference code, which also carries a layer of 256 to 128 that nothing reads
(`UNREAD_PARAMETERS`); it is in their file sizes and not here.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor, nn

DEPTH, WIDTH, JOINED = 8, 256, 5  # the input joins again at layer `JOINED`, counted from 0
OCTAVES = 10
UNREAD_PARAMETERS = WIDTH * 128 + 128


def encode(values: Tensor, frequencies: int = OCTAVES) -> Tensor:
    """Values (..., d) with sines and cosines at 2^0 .. 2^(frequencies - 1), (..., d (1 + 2 frequencies))."""
    parts = [values]
    for octave in range(frequencies):
        angle = values * 2.0**octave
        parts += [angle.sin(), angle.cos()]
    return torch.cat(parts, dim=-1)


class EncodedPerceptron(nn.Module):
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
