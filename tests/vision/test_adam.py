"""Adam against its formula, in double precision."""

import numpy as np
import torch

from objectfolder.making.visionnet.training import EPSILON, Adam


def test_steps_are_those_of_the_formula_and_what_has_no_gradient_stays() -> None:
    start, gradients = np.array([1.0, -2.0, 0.5]), np.random.default_rng(0).normal(size=(5, 3))
    moved, still = (torch.tensor(start, requires_grad=True) for _ in range(2))
    optimiser = Adam([still, moved])
    expected, mean, square = start.copy(), np.zeros(3), np.zeros(3)
    for count, gradient in enumerate(gradients, start=1):
        moved.grad = torch.tensor(gradient)
        optimiser.step(0.1 / count)
        mean, square = 0.9 * mean + 0.1 * gradient, 0.999 * square + 0.001 * gradient**2
        size = np.sqrt(square / (1 - 0.999**count)) + EPSILON
        expected -= 0.1 / count * mean / (1 - 0.9**count) / size
        assert moved.grad is None
    np.testing.assert_allclose(moved.detach().numpy(), expected, rtol=1e-12)
    np.testing.assert_array_equal(still.detach().numpy(), start)
