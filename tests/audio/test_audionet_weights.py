"""Weights of training points in fits of AudioNet."""

from dataclasses import replace

import numpy as np
import pytest

from objectfolder.audio.audionet.surface_kernel import KernelParameters, SurfaceKernel
from objectfolder.making.audionet import least_squares
from objectfolder.making.audionet.corrections import Fields
from objectfolder.making.audionet.least_squares import Basis, Data, equations, solve
from objectfolder.surface.surface import Surface

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
FACES += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
CUBE = Surface(CORNERS, np.array(FACES))


@pytest.fixture
def data() -> Data:
    """Values of two columns at 300 points of a cube."""
    samples = CUBE.sample(300, 0)
    x, y, z = samples.points.T
    values = np.stack([np.sin(3 * x) * y, np.cos(2 * z) + x], axis=1)
    return Data(samples.face, samples.barycentric, values, np.ones(300))


@pytest.fixture
def basis(data: Data) -> Basis:
    kernel = SurfaceKernel(CUBE, np.zeros((len(CORNERS), 0)), KernelParameters())
    return Basis(kernel, (data.face[:40], np.floor(data.barycentric[:40, :2] * 255).astype(np.uint8)))


def test_a_weight_of_root_two_counts_a_point_twice(data: Data, basis: Basis) -> None:
    heavy = np.arange(300) % 3 == 0
    weighted = replace(data, weights=np.where(heavy, np.sqrt(2), 1.0))
    twice = data.joined(data.part(heavy))
    # All points are used: the normal matrix takes no more than some a control.
    assert len(twice.values) < 2 * least_squares.MOST_POINTS_A_CONTROL * 40
    fields = [Fields(basis, solve(*equations(basis, points))) for points in (weighted, twice)]
    np.testing.assert_allclose(fields[0].coefficients, fields[1].coefficients, rtol=1e-6, atol=1e-9)
    smooth = Fields(basis, solve(*equations(basis, data)))
    first, second = (smooth.corrected(points, (0.1,))[0].corrections for points in (weighted, twice))
    assert first is not None
    assert np.abs(first).max() > 1e-3
    np.testing.assert_allclose(second, first, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("scale", [1.0, 1e-9, 1e12])
def test_quiet_points_weigh_more_and_loud_points_as_those_at_the_rms(scale: float) -> None:
    sizes = np.array([0.0, 0.1, 0.4, 1.0, 8.0])
    floor = 0.1 * np.sqrt(np.mean(sizes**2))
    counted = np.maximum(sizes, floor)
    counted[-1] = np.sqrt(np.mean(counted**2))
    values = scale * sizes[:, None] * np.array([[0.6, 0.8]])
    weights = Data.weighted(np.zeros(5, dtype=np.int64), np.ones((5, 3)) / 3, values).weights
    np.testing.assert_allclose(weights / weights[-1], np.sqrt(counted[-1] / counted))
    np.testing.assert_allclose(np.mean(weights**2), 1.0)


def test_points_of_which_none_moves_weigh_alike() -> None:
    data = Data.weighted(np.zeros(4, dtype=np.int64), np.ones((4, 3)) / 3, np.zeros((4, 6)))
    np.testing.assert_array_equal(data.weights, np.ones(4))


def test_what_hardly_moves_is_met_better_for_its_weight(basis: Basis, data: Data) -> None:
    """A cube that shakes at one end and hardly at the other, by functions that are too few for it."""
    points = np.einsum("nc,nck->nk", data.barycentric, CORNERS[CUBE.faces[data.face]])
    x, y, z = points.T
    loud = np.where(x > 0.5, 1.0, 0.05)[:, None]
    values = loud * np.stack([np.sin(9 * y), np.cos(11 * z), np.sin(10 * y * z)], axis=1)
    quiet = x < 0.5
    errors = []
    weighted = Data.weighted(data.face, data.barycentric, values)
    for samples in (replace(weighted, weights=np.ones(300)), weighted):
        misfit = Fields(basis, solve(*equations(basis, samples))).at(samples) - values
        errors.append(np.linalg.norm(misfit[quiet]) / np.linalg.norm(values[quiet]))
    assert errors[1] < 0.8 * errors[0]
