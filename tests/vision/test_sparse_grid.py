import numpy as np
import pytest

from objectfolder.errors import FormatError
from objectfolder.vision.network.sparse_grid import GRID_LEVELS, HALF_WIDTH, SparseGrid


@pytest.fixture
def points() -> np.ndarray:
    directions = np.random.default_rng(0).normal(size=(5000, 3))
    return 0.5 * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_linear_functions_are_interpolated_exactly(points):
    grid = SparseGrid.of_points(points, 24)
    for level, (rows, weights) in enumerate(grid.interpolation(points)):
        cells = 24 >> (GRID_LEVELS - 1 - level)
        lookup = grid.lookups[level]
        position = np.stack(np.unravel_index(np.flatnonzero(lookup >= 0), (cells + 1,) * 3), axis=1)
        table = position * (2 * HALF_WIDTH / cells) - HALF_WIDTH
        assert grid.sizes[level] == len(table)
        np.testing.assert_allclose(np.einsum("nk,nkj->nj", weights, table[rows]), points, atol=1e-6)


def test_stored_bytes_number_the_corners_alike(points):
    grid = SparseGrid.of_points(points, 40)
    again = SparseGrid.from_bytes(grid.to_bytes(), 40)
    assert all(np.array_equal(a, b) for a, b in zip(grid.lookups, again.lookups, strict=True))
    with pytest.raises(FormatError):
        SparseGrid.from_bytes(grid.to_bytes()[:-5], 40)
    with pytest.raises(FormatError):
        SparseGrid.from_bytes(grid.to_bytes(), 64)


def test_points_in_unseen_cells_and_outside_the_cube_are_answered(points):
    grid = SparseGrid.of_points(points, 24)
    for _, weights in grid.interpolation(np.array([[0.49, 0.0, 0.0], [0.0, 0.0, 0.0], [3.0, -3.0, 0.2]])):
        assert np.isfinite(weights).all()
        total = weights.sum(axis=1)
        assert (np.isclose(total, 1, atol=1e-5) | (total == 0)).all()


def test_the_budget_bounds_the_corners(points):
    grid = SparseGrid.within_budget(points, 4000, 64)
    assert grid.sizes[-1] <= 4000
    assert grid.resolution % 8 == 0
    assert SparseGrid.within_budget(points, 10**6, 64).resolution == 64
