"""Adam by torch's function: its class imports torch's compiler, 2.5 CPU-s in each process that fits."""

from collections.abc import Iterable

import torch
from torch.optim.adam import adam

EPSILON = 1e-12


class Adam:
    """Moves parameters against their gradients, each by about the rate.

    Parameters
    ----------
    parameters
        Tensors that gradients flow to.
    """

    def __init__(self, parameters: Iterable[torch.Tensor]) -> None:
        self._parameters = list(parameters)
        self._means = [torch.zeros_like(each) for each in self._parameters]
        self._squares = [torch.zeros_like(each) for each in self._parameters]
        self._counts = [torch.zeros(()) for _ in self._parameters]

    def step(self, rate: float) -> None:
        """Move those that have a gradient, and forget it."""
        moved = [index for index, each in enumerate(self._parameters) if each.grad is not None]
        lists = (self._parameters, self._means, self._squares, self._counts)
        parameters, means, squares, counts = ([values[index] for index in moved] for values in lists)
        gradients = [each.grad for each in parameters if each.grad is not None]
        with torch.no_grad():
            adam(
                parameters, gradients, means, squares, [], counts, foreach=True, amsgrad=False,
                beta1=0.9, beta2=0.999, lr=rate, weight_decay=0.0, eps=EPSILON, maximize=False,
            )  # fmt: skip
        for each in parameters:
            each.grad = None
