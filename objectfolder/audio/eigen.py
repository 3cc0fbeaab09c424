"""Every elastic mode of a free body below a limit, with a count that proves none is missing.

The pencil K u = lambda M u is solved by a block Lanczos iteration on (K - sigma M)^-1 M, sigma < 0 small, in
the M-orthogonal complement of the rigid-body motions, which are known in closed form. The count comes from
Sylvester's law of inertia: the negative pivots of K - lambda M are the eigenvalues below lambda
(B. N. Parlett, The Symmetric Eigenvalue Problem, ch. 3 and 13).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse.linalg import SuperLU, splu

from objectfolder.errors import SimulationError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
BLOCK = 16
# Unknowns up to which a dense solver is used.
DENSE = 900


def factorise(matrix: sparse.csc_matrix) -> SuperLU:
    """Sparse L D L^T of a symmetric matrix in the form of an LU without interchanges."""
    return splu(
        matrix.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def count_below(stiffness: sparse.csc_matrix, mass: sparse.csc_matrix, value: float) -> int:
    """Number of eigenvalues of K u = lambda M u below `value`, by the inertia of K - value M.

    Raises
    ------
    SimulationError
        When the factorisation had to interchange rows, so that its pivots prove nothing.
    """
    factors = factorise(stiffness - value * mass)
    if not np.array_equal(factors.perm_r, factors.perm_c):
        raise SimulationError(
            "count of modes",
            f"a pivot of K - {value:.6g} M vanished",
            "Move the frequency limit a little away from an eigenfrequency.",
        )
    return int(np.count_nonzero(factors.U.diagonal() < 0))


def rigid_motions(positions: Floats, component: Integers, mass: sparse.csc_matrix) -> Floats:
    """M-orthonormal translations and rotations of each component, (3 n, 6 components) float64.

    Parameters
    ----------
    positions : (n, 3) nodes
    component : (n,) component of each node, 0 .. components - 1
    mass : (3 n, 3 n)
    """
    columns = []
    for index in range(int(component.max()) + 1):
        inside = component == index
        centred = positions - positions[inside].mean(axis=0)
        for axis in range(3):
            translation = np.zeros_like(positions)
            translation[inside, axis] = 1
            rotation = np.zeros_like(positions)
            rotation[inside] = np.cross(np.eye(3)[axis], centred[inside])
            columns += [translation.ravel(), rotation.ravel()]
    motions = np.stack(columns, axis=1)
    return orthonormalise(motions / np.linalg.norm(motions, axis=0), mass)[0]


def orthonormalise(block: Floats, mass: sparse.csc_matrix) -> tuple[Floats, Floats]:
    """M-orthonormal basis Q of the columns and R with block = Q R; two passes of Cholesky QR."""
    triangle = np.eye(block.shape[1])
    for _ in range(2):
        gram = block.T @ (mass @ block)
        upper = linalg.cholesky((gram + gram.T) / 2)
        block = linalg.solve_triangular(upper, block.T, trans="T").T
        triangle = upper @ triangle
    return block, triangle


@dataclass(frozen=True)
class Eigenpairs:
    """Elastic modes in ascending order.

    Attributes
    ----------
    values : (k,) float64 eigenvalues
    vectors : (3 n, k) float64, u^T M u = 1
    solves : right-hand sides solved
    """

    values: Floats
    vectors: Floats
    solves: int


def lowest_elastic(
    stiffness: sparse.csc_matrix,
    mass: sparse.csc_matrix,
    rigid: Floats,
    *,
    below: float,
    at_most: int,
    shift: float,
    tolerance: float = 1e-8,
    seed: int = 0,
) -> Eigenpairs:
    """Elastic pairs of the pencil in ascending order: all below `below`, or the first `at_most` of them.

    Returned are the wanted pairs and at least one more converged pair beyond, so that a caller can cut in
    a gap.

    Parameters
    ----------
    rigid
        M-orthonormal null vectors, (3 n, r).
    below
        Upper end of the wanted interval.
    at_most
        Largest number of pairs wanted.
    shift
        sigma < 0, of the order of the first elastic eigenvalue.
    tolerance
        Bound on the residual |(A - theta) x|_M of A = (K - sigma M)^-1 M relative to theta = 1 / (lambda -
        sigma).

    Raises
    ------
    SimulationError
        When the iteration does not converge in 400 blocks.
    """
    size = stiffness.shape[0]
    if size <= DENSE:
        values, vectors = linalg.eigh(stiffness.toarray(), mass.toarray())
        values, vectors = values[rigid.shape[1] :], vectors[:, rigid.shape[1] :]
        kept = min(int(np.count_nonzero(values < below)), at_most) + 1
        return Eigenpairs(values[:kept], vectors[:, :kept], 0)
    factors = factorise(stiffness - shift * mass)
    block = BLOCK
    generator = np.random.default_rng(seed)
    mass_rigid = mass @ rigid

    def without_rigid(x: Floats) -> Floats:
        return x - rigid @ (mass_rigid.T @ x)

    start = without_rigid(factors.solve(generator.standard_normal((size, block))))
    current, _ = orthonormalise(start, mass)
    capacity = max(3 * min(at_most, 4096) + 4 * block, 10 * block)
    basis = np.empty((size, capacity + block), order="F")
    mass_basis = np.empty_like(basis)
    projected = np.zeros((0, 0))
    width = 0
    solves = block
    for step in range(400):
        here = slice(width, width + block)
        width += block
        basis[:, here] = current
        mass_basis[:, here] = mass @ current
        image = without_rigid(factors.solve(mass_basis[:, here]))
        solves += block
        coefficients = np.zeros((width, block))
        for _ in range(2):  # orthogonalised twice: once leaves rounding errors that grow
            part = mass_basis[:, :width].T @ image
            image -= basis[:, :width] @ part
            coefficients += part
        grown = np.zeros((width, width))
        grown[:-block, :-block] = projected
        grown[:, -block:] = coefficients
        grown[-block:, :] = coefficients.T
        projected = grown
        current, remainder = orthonormalise(without_rigid(image), mass)
        full = width + block > capacity
        if width > 16 * block and step % 3 and not full:
            continue  # the small eigenproblem is not free either
        theta, ritz = linalg.eigh(projected)
        theta, ritz = theta[::-1], ritz[:, ::-1]
        residual = np.linalg.norm(remainder @ ritz[-block:], axis=0)
        wanted = _wanted(theta, shift, below, at_most)
        if wanted < width and np.all(residual[:wanted] <= tolerance * theta[:wanted]):
            values = shift + 1 / theta[:wanted]
            return Eigenpairs(values, basis[:, :width] @ ritz[:, :wanted], solves)
        if full:
            kept = min(width - block, wanted + 2 * block)
            basis[:, :kept] = basis[:, :width] @ ritz[:, :kept]
            mass_basis[:, :kept] = mass_basis[:, :width] @ ritz[:, :kept]
            projected = np.diag(theta[:kept])
            width = kept
    raise SimulationError(
        "eigenvalue solver",
        f"no convergence after {solves} solves of {size} unknowns",
        "Lower the frequency limit or the number of modes.",
    )


def _wanted(theta: Floats, shift: float, below: float, at_most: int) -> int:
    """Leading Ritz values that must converge: those below the limit (at most `at_most`) and one beyond."""
    positive = theta > 0
    inside = int(np.count_nonzero(positive & (shift + 1 / np.where(positive, theta, 1.0) < below)))
    return min(inside, at_most) + 1
