"""Both factorisations against dense linear algebra."""

import numpy as np
import pytest
from scipy import sparse
from structured_solids import box

from objectfolder.errors import SimulationError
from objectfolder.making import factorisation
from objectfolder.making.elements.elasticity import assemble
from objectfolder.making.factorisation import SOLVER, Factorisation, shifted
from objectfolder.making.modes.spectrum import space_on

SOLVERS = sorted({"SuperLU", SOLVER})


def matrix(size: int = 60, seed: int = 0) -> sparse.csr_matrix:
    generator = np.random.default_rng(seed)
    part = sparse.random(size, size, 0.1, random_state=generator).tocsr()
    return (part + part.T + sparse.identity(size)).tocsr()


@pytest.mark.parametrize("solver", SOLVERS)
def test_solutions_are_those_of_a_dense_solver(solver: str) -> None:
    definite = (matrix() @ matrix() + sparse.identity(60)).tocsr()
    right = np.random.default_rng(1).standard_normal(
        (60, factorisation.RIGHT_SIDES_AT_ONCE + 5)
    )  # in two parts
    solutions = Factorisation(definite, definite=True, solver=solver).solve(right)
    np.testing.assert_allclose(solutions, np.linalg.solve(definite.toarray(), right), atol=1e-11)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("shift", [-3.0, 0.2, 1.1, 9.0])
def test_negative_pivots_are_negative_eigenvalues(solver: str, shift: float) -> None:
    moved = (matrix() - shift * sparse.identity(60)).tocsr()
    exact = int(np.count_nonzero(np.linalg.eigvalsh(moved.toarray()) < 0))
    try:
        counted = Factorisation(moved, definite=False, solver=solver).negative()
    except SimulationError:
        assert solver == "SuperLU"  # it refuses to count where it had to interchange rows
    else:
        assert counted == exact


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_singular_matrix_is_refused(solver: str) -> None:
    singular = sparse.csr_matrix(np.array([[1.0, 1.0], [1.0, 1.0]]))
    with pytest.raises(SimulationError):
        Factorisation(singular, definite=True, solver=solver)


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_indefinite_matrix_is_refused_where_a_definite_one_is_promised(solver: str) -> None:
    indefinite = sparse.diags([[1.0, -1.0, 2.0], [0.1, 0.1], [0.1, 0.1]], [0, 1, -1]).tocsr()
    with pytest.raises(SimulationError):
        Factorisation(indefinite, definite=True, solver=solver)


@pytest.mark.parametrize("solver", SOLVERS)
def test_growth_of_entries_gives_no_wrong_count(solver: str) -> None:
    """A pivot of 1e-18: what is beside it drowns in the rounding of 1e18, and no pivot vanishes."""
    part = np.random.default_rng(3).standard_normal((6, 6))
    hard = part + part.T
    hard[0] = hard[:, 0] = [1e-18, 1.0, 0.1, 0.0, 0.0, 0.0]
    factors = Factorisation(sparse.csr_matrix(hard), definite=False, solver=solver)
    assert factors.backward_error() > 1e-3
    with pytest.raises(SimulationError, match="pivot"):
        factors.negative()


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_backward_error_of_a_solid_is_rounding(solver: str) -> None:
    stiffness, mass = assemble(space_on(box((4, 4, 1), (1, 1, 0.01)), 2, 1.0)[0], 0.3)
    factors = Factorisation(shifted(stiffness, mass, 25.0), definite=False, solver=solver)
    assert factors.backward_error() < 1e-14


@pytest.mark.parametrize("solver", SOLVERS)
def test_blocks_are_factorised_as_their_entries(solver: str) -> None:
    stiffness, mass = assemble(space_on(box((2, 2, 1), (1, 1, 0.1)), 2, 1.0)[0], 0.3)
    dense = stiffness.toarray() - 25.0 * np.kron(mass.toarray(), np.eye(3))
    right = np.random.default_rng(4).standard_normal((len(dense), 3))
    factors = Factorisation(shifted(stiffness, mass, 25.0), definite=False, solver=solver)
    assert factors.negative() == np.count_nonzero(np.linalg.eigvalsh(dense) < 0)
    np.testing.assert_allclose(factors.solve(right), np.linalg.solve(dense, right), rtol=1e-9, atol=1e-9)


def test_solutions_need_no_entries_of_the_matrix() -> None:
    """Of a definite matrix, and of an indefinite one after its count: they are dropped."""
    right = np.random.default_rng(2).standard_normal((60, 3))
    moved = (matrix() - 1.1 * sparse.identity(60)).tocsr()
    factors = Factorisation(moved, definite=False)
    before = factors.solve(right)
    factors.negative()
    np.testing.assert_array_equal(factors.solve(right), before)
    if SOLVER == "PARDISO":
        with pytest.raises(ValueError, match="gone"):
            factors.backward_error()


def hermitian(shift: float, size: int = 20) -> sparse.bsr_matrix:
    """In blocks of 3, with eigenvalues on both sides of zero."""
    generator = np.random.default_rng(5)
    part = np.kron(sparse.random(size, size, 0.15, random_state=generator).toarray() != 0, np.ones((3, 3)))
    part = part * (generator.standard_normal(part.shape) + 1j * generator.standard_normal(part.shape))
    return sparse.bsr_matrix(part @ part.conj().T - shift * np.eye(3 * size), blocksize=(3, 3))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("shift", [0.3, 7.0])
def test_complex_factors_count_and_solve(solver: str, shift: float) -> None:
    matrix = hermitian(shift)
    right = np.random.default_rng(6).standard_normal((60, 2)) * (1 + 0.5j)
    factors = Factorisation(matrix, definite=False, solver=solver)
    np.testing.assert_allclose(factors.solve(right), np.linalg.solve(matrix.toarray(), right), rtol=1e-6)
    assert factors.negative() == np.count_nonzero(np.linalg.eigvalsh(matrix.toarray()) < 0) > 0


def test_complex_entries_that_grow_on_the_diagonal_are_counted_in_the_real_form() -> None:
    """A pivot of 1e-18, which PARDISO leaves on the diagonal of a complex matrix only."""
    matrix = hermitian(0.3).toarray()
    matrix[0, 0] = 1e-18
    counted = Factorisation(sparse.bsr_matrix(matrix, blocksize=(3, 3)), definite=False).negative()
    assert counted == np.count_nonzero(np.linalg.eigvalsh(matrix) < 0)
