"""Blocks of vectors that are nearly dependent, and iterations that break down."""

import numpy as np
import pytest
from scipy import linalg, sparse
from structured_solids import box

from objectfolder.errors import SimulationError
from objectfolder.making.elements.elasticity import assemble
from objectfolder.making.modes import eigen
from objectfolder.making.modes.eigen import Pencil, lowest_elastic, orthonormalise, rigid_motions, weigh
from objectfolder.making.modes.spectrum import space_on


def nearly_dependent(condition: float) -> np.ndarray:
    """(300, 6) with singular values from 1 to 1 / condition."""
    generator = np.random.default_rng(0)
    left, _ = np.linalg.qr(generator.standard_normal((300, 6)))
    right, _ = np.linalg.qr(generator.standard_normal((6, 6)))
    return np.asarray(left * np.geomspace(1, 1 / condition, 6) @ right)


def plain_loss(block: np.ndarray, mass: sparse.csr_matrix) -> float:
    """How far from orthonormal Cholesky QR without a shift leaves a block; infinite where it has no factor.

    Which of the two a processor shows at a condition near the limit is a matter of the last bit.
    """
    try:
        upper = linalg.cholesky(block.T @ weigh(mass, block))
    except np.linalg.LinAlgError:
        return np.inf
    basis = linalg.solve_triangular(upper, block.T, trans="T").T
    return float(np.abs(basis.T @ weigh(mass, basis) - np.eye(block.shape[1])).max())


@pytest.mark.parametrize("condition", [1e8, 1e10, 1e12])
def test_dependent_vectors_are_orthonormalised_where_plain_cholesky_qr_is_not(condition: float) -> None:
    mass = sparse.diags(np.linspace(1, 5, 100)).tocsr()
    block = nearly_dependent(condition)
    assert plain_loss(block, mass) > 1e-3
    basis, triangle = orthonormalise(block, mass)
    np.testing.assert_allclose(basis.T @ weigh(mass, basis), np.eye(6), atol=1e-13)
    np.testing.assert_allclose(basis @ triangle, block, atol=1e-14)


def test_a_vector_of_zeros_cannot_be_orthonormalised() -> None:
    """Its row of the Gram matrix is exactly zero, and so is a pivot, whatever the order of the sums."""
    mass = sparse.diags(np.linspace(1, 5, 100)).tocsr()
    with pytest.raises(np.linalg.LinAlgError):
        orthonormalise(nearly_dependent(1e3) * np.array([1, 1, 1, 1, 1, 0]), mass)


def test_an_iteration_that_breaks_down_starts_again(monkeypatch: pytest.MonkeyPatch) -> None:
    space, _ = space_on(box((4, 4, 2), (1, 1, 0.3)), 2, 1.0)
    stiffness, mass = assemble(space, 0.3)
    assert stiffness.shape[0] > eigen.DENSE
    rigid = rigid_motions(space.geometry, np.zeros(space.size, dtype=np.int64), space.vertex_count, mass)

    def lowest() -> np.ndarray:
        return lowest_elastic(Pencil(stiffness, mass, rigid), below=np.inf, at_most=8, shift=-0.05).values

    whole = lowest()
    calls: list[int] = []

    def breaking_down(block: np.ndarray, mass: sparse.csr_matrix) -> tuple[np.ndarray, np.ndarray]:
        calls.append(1)
        return orthonormalise(np.zeros_like(block) if len(calls) in broken else block, mass)

    monkeypatch.setattr(eigen, "orthonormalise", breaking_down)
    broken = {2}
    np.testing.assert_allclose(lowest(), whole, rtol=1e-8)
    broken = set(range(1000))
    with pytest.raises(SimulationError, match="2 random starts"):
        lowest()
