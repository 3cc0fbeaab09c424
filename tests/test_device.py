"""Where what has a choice computes: what is not there is named, and another device has the same answers."""

import numpy as np
import pytest
import torch

from objectfolder.errors import SimulationError
from objectfolder.making.air import helmholtz
from objectfolder.making.device import CPU, DEVICE, torch_device


def test_a_device_that_is_not_there_is_named(monkeypatch):
    monkeypatch.delenv(DEVICE, raising=False)
    assert torch_device().type == "cpu"
    monkeypatch.setenv(DEVICE, "CUDA")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(SimulationError, match=f"finds no CUDA device here. Set {DEVICE} to {CPU}"):
        torch_device()


def test_dense_systems_of_the_air_have_the_same_solution_by_torch(monkeypatch):
    random = np.random.default_rng(0)
    real, imaginary = random.normal(size=(2, 40, 43))
    matrix, right = np.split((real + 1j * imaginary).astype(np.complex64), [40], axis=1)
    expected = helmholtz._solve_dense(matrix.copy(), right)
    np.testing.assert_allclose(matrix @ expected, right, atol=1e-4)
    monkeypatch.setenv(DEVICE, "CUDA")
    monkeypatch.setattr(helmholtz, "torch_device", lambda: torch.device("cpu"))
    np.testing.assert_allclose(helmholtz._solve_dense(matrix, right), expected, rtol=1e-3, atol=1e-5)
