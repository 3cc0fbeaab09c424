"""Every elastic mode of a free body below a limit, with a count that proves none is missing.

The pencil K u = lambda M u is solved by a block Lanczos iteration on (K - sigma M)^-1 M, sigma < 0 small, in
the M-orthogonal complement of the rigid-body motions, which are known in closed form (B. N. Parlett, The
Symmetric Eigenvalue Problem, ch. 13). The mass matrix is the same for the three axes and is given once.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

from objectfolder.audio.factorisation import Factorisation
from objectfolder.audio.modes.subspace import refine, weigh
from objectfolder.errors import SimulationError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
BLOCK, MOST_BLOCKS = 16, 400
# Random starts of the iteration, where its blocks become dependent.
MOST_STARTS = 2
# Unknowns up to which a dense solver is used.
DENSE = 900
# Rounds of inverse iteration for what only has to be nearly right.
NEARLY = 2


def shifted(stiffness: sparse.csr_matrix, mass: sparse.csr_matrix, value: float) -> sparse.csr_matrix:
    """K - value M, (3 n, 3 n)."""
    rows = np.repeat(np.arange(mass.shape[0]), np.diff(mass.indptr))
    # Where the blocks of K are those of M: the first entry of the first row of each, and the next row's.
    width = 3 * np.diff(mass.indptr)[rows]
    start = 9 * mass.indptr[rows].astype(np.int64)
    place = start + 3 * (np.arange(mass.nnz) - mass.indptr[rows])
    alike = (
        stiffness.nnz == 9 * mass.nnz
        and np.array_equal(stiffness.indptr[::3], 9 * mass.indptr)
        and np.array_equal(stiffness.indices[place], 3 * mass.indices)
    )
    if not alike:
        return (stiffness - value * sparse.kron(mass, sparse.identity(3), format="csr")).tocsr()
    result = stiffness.copy()
    for axis in range(3):
        result.data[place + axis * (width + 1)] -= value * mass.data
    return result


def count_below(stiffness: sparse.csr_matrix, mass: sparse.csr_matrix, value: float) -> int:
    """Number of eigenvalues of K u = lambda M u below `value`, by the inertia of K - value M.

    Raises
    ------
    SimulationError
        When a pivot vanished, so that the signs of the others prove nothing.
    """
    return Factorisation(shifted(stiffness, mass, value), definite=False).negative()


def rigid_motions(
    geometry: Floats, component: Integers, vertex_count: int, mass: sparse.csr_matrix
) -> Floats:
    """M-orthonormal translations and rotations of each component, (3 n, 6 components) float64.

    Parameters
    ----------
    geometry : (n, 3) position as a field of the space; the first `vertex_count` functions sum to 1
    component : (n,) component of each function, 0 .. components - 1
    mass : (n, n) of one axis
    """
    columns = []
    for index in range(int(component.max()) + 1):
        inside = component == index
        one = inside & (np.arange(len(geometry)) < vertex_count)
        centred = np.where(inside[:, None], geometry, 0.0)
        centred[one] -= centred[one].mean(axis=0)
        for axis in range(3):
            translation = np.zeros_like(geometry)
            translation[one, axis] = 1
            rotation = np.cross(np.eye(3)[axis], centred)
            columns += [translation.ravel(), rotation.ravel()]
    motions = np.stack(columns, axis=1)
    return orthonormalise(motions / np.linalg.norm(motions, axis=0), mass)[0]


def orthonormalise(block: Floats, mass: sparse.csr_matrix) -> tuple[Floats, Floats]:
    """M-orthonormal basis Q (n, k) of the columns and R (k, k) with block = Q R, by Cholesky QR.

    Two passes; three, the first of a shifted Gram matrix, where the columns are nearly dependent (T. Fukaya
    et al., "Shifted Cholesky QR for computing the QR factorization of ill-conditioned matrices", SIAM J. Sci.
    Comput. 42, 2020). The plain form breaks down from a condition number of some 1e8 on.

    Raises
    ------
    numpy.linalg.LinAlgError
        The columns are dependent to rounding.
    """
    try:
        return _twice(block, mass)
    except np.linalg.LinAlgError:
        better, first = _cholesky_qr(block, mass, 11 * block.size * float(np.finfo(np.float64).eps))
        basis, rest = _twice(better, mass)
        return basis, rest @ first


def _twice(block: Floats, mass: sparse.csr_matrix) -> tuple[Floats, Floats]:
    once, first = _cholesky_qr(block, mass, 0.0)
    basis, second = _cholesky_qr(once, mass, 0.0)
    return basis, second @ first


def _cholesky_qr(block: Floats, mass: sparse.csr_matrix, shift: float) -> tuple[Floats, Floats]:
    """Q and R of the Gram matrix plus `shift` times its norm."""
    gram = block.T @ weigh(mass, block)
    gram = (gram + gram.T) / 2
    if shift:
        gram += shift * np.linalg.norm(gram, 2) * np.eye(len(gram))
    upper = linalg.cholesky(gram)
    return linalg.solve_triangular(upper, block.T, trans="T").T, upper


@dataclass(frozen=True)
class Eigenpairs:
    """Elastic modes in ascending order.

    Attributes
    ----------
    values : (k,) float64 eigenvalues
    vectors : (3 n, k) float64, u^T M u = 1
    """

    values: Floats
    vectors: Floats


def lowest_elastic(
    stiffness: sparse.csr_matrix,
    mass: sparse.csr_matrix,
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
    stiffness, mass
        (3 n, 3 n), and (n, n) of one axis.
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
        When the iteration does not converge in `MOST_BLOCKS` blocks, or breaks down from every start.
    """
    size = stiffness.shape[0]
    if size <= DENSE:
        values, vectors = linalg.eigh(stiffness.toarray(), np.kron(mass.toarray(), np.eye(3)))
        values, vectors = values[rigid.shape[1] :], vectors[:, rigid.shape[1] :]
        kept = min(int(np.count_nonzero(values < below)), at_most) + 1
        return Eigenpairs(values[:kept], vectors[:, :kept])
    factors = Factorisation(shifted(stiffness, mass, shift), definite=True)
    for attempt in range(MOST_STARTS):
        try:
            lanczos = _Lanczos(factors, mass, rigid, at_most, np.random.default_rng(seed + attempt))
            return lanczos.pairs(shift, below, at_most, tolerance)
        except np.linalg.LinAlgError:  # the block of vectors became dependent
            continue
    raise SimulationError(
        "eigenvalue solver",
        f"blocks of vectors became dependent from {MOST_STARTS} random starts of {size} unknowns",
        "Change the seed.",
    )


class _Lanczos:
    """Block Lanczos basis of (K - sigma M)^-1 M in the M-orthogonal complement of the rigid motions."""

    def __init__(
        self,
        factors: Factorisation,
        mass: sparse.csr_matrix,
        rigid: Floats,
        at_most: int,
        generator: np.random.Generator,
    ) -> None:
        self._factors, self._mass, self._rigid = factors, mass, rigid
        self._mass_rigid = weigh(mass, rigid)
        size = len(rigid)
        start = self._without_rigid(factors.solve(generator.standard_normal((size, BLOCK))))
        self._next, self._remainder = orthonormalise(start, mass)
        self._capacity = max(3 * min(at_most, 4096) + 4 * BLOCK, 10 * BLOCK)
        self._basis = np.empty((size, self._capacity + BLOCK), order="F")
        self._mass_basis = np.empty_like(self._basis)
        self._projected = np.zeros((0, 0))

    def pairs(self, shift: float, below: float, at_most: int, tolerance: float) -> Eigenpairs:
        """Wanted pairs, as `lowest_elastic` says."""
        for step in range(MOST_BLOCKS):
            self._grow()
            width = len(self._projected)
            full = width + BLOCK > self._capacity
            if width > 16 * BLOCK and step % 3 and not full:
                continue  # the small eigenproblem is not free either
            theta, ritz = linalg.eigh(self._projected)
            theta, ritz = theta[::-1], ritz[:, ::-1]
            residual = np.linalg.norm(self._remainder @ ritz[-BLOCK:], axis=0)
            wanted = _wanted(theta, shift, below, at_most)
            if wanted < width and np.all(residual[:wanted] <= tolerance * theta[:wanted]):
                return Eigenpairs(shift + 1 / theta[:wanted], self._basis[:, :width] @ ritz[:, :wanted])
            if full:
                self._restart(theta, ritz, min(width - BLOCK, wanted + 2 * BLOCK))
        raise SimulationError(
            "eigenvalue solver",
            f"no convergence after {MOST_BLOCKS} blocks of {len(self._rigid)} unknowns",
            "Lower the frequency limit or the number of modes.",
        )

    def _without_rigid(self, vectors: Floats) -> Floats:
        return vectors - self._rigid @ (self._mass_rigid.T @ vectors)

    def _grow(self) -> None:
        """Add the next block to the basis and find the one after it."""
        width = len(self._projected) + BLOCK
        here = slice(width - BLOCK, width)
        self._basis[:, here] = self._next
        self._mass_basis[:, here] = weigh(self._mass, self._next)
        image = self._without_rigid(self._factors.solve(self._mass_basis[:, here]))
        coefficients = np.zeros((width, BLOCK))
        for _ in range(2):  # orthogonalised twice: once leaves rounding errors that grow
            part = self._mass_basis[:, :width].T @ image
            image -= self._basis[:, :width] @ part
            coefficients += part
        grown = np.zeros((width, width))
        grown[:-BLOCK, :-BLOCK] = self._projected
        grown[:, -BLOCK:] = coefficients
        grown[-BLOCK:, :] = coefficients.T
        self._projected = grown
        self._next, self._remainder = orthonormalise(self._without_rigid(image), self._mass)

    def _restart(self, theta: Floats, ritz: Floats, kept: int) -> None:
        """Keep the first Ritz vectors alone (thick restart)."""
        width = len(theta)
        self._basis[:, :kept] = self._basis[:, :width] @ ritz[:, :kept]
        self._mass_basis[:, :kept] = self._mass_basis[:, :width] @ ritz[:, :kept]
        self._projected = np.diag(theta[:kept])


def improve(
    stiffness: sparse.csr_matrix, mass: sparse.csr_matrix, rigid: Floats, start: Floats, *, shift: float
) -> Eigenpairs:
    """Elastic pairs from near-by vectors, by two rounds of `subspace.refine`.

    As many as `start` (3 n, k) has, in ascending order. Enough for what only has to be nearly right: an
    eigenvalue is off by the square of how far its vector is.
    """
    size, count = start.shape
    if size <= DENSE:
        return lowest_elastic(stiffness, mass, rigid, below=np.inf, at_most=count, shift=shift)
    factors = Factorisation(shifted(stiffness, mass, shift), definite=True)
    values, vectors, _ = refine(
        factors, shift, mass, rigid, start, below=np.inf, tolerance=0.0, rounds=NEARLY
    )
    return Eigenpairs(values, vectors)


def _wanted(theta: Floats, shift: float, below: float, at_most: int) -> int:
    """Leading Ritz values that must converge: those below the limit (at most `at_most`) and one beyond."""
    positive = theta > 0
    inside = int(np.count_nonzero(positive & (shift + 1 / np.where(positive, theta, 1.0) < below)))
    return min(inside, at_most) + 1
