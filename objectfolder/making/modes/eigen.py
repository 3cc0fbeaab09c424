"""Elastic modes of a free body: the pencil K u = lambda M u, its count below a limit, and its lowest pairs.

All is in the M-orthogonal complement of the rigid-body motions, which are known in closed form. From nothing,
modes are found by block Lanczos on (K - sigma M)^-1 M, sigma < 0 small (B. N. Parlett, The Symmetric
Eigenvalue Problem, ch. 13); from near-by vectors, by `inverse_iteration`. The mass is the same for the three
axes and is given once.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

from objectfolder.errors import UnsolvableError
from objectfolder.making.factorisation import RIGHT_SIDES_AT_ONCE, Factorisation, shifted
from objectfolder.making.modes.limits import NO_LIMITS, Limits

Floats = NDArray[np.float64]
Values = NDArray[Any]  # float64 or complex128
Integers = NDArray[np.int64]
BLOCK_COLUMNS, MOST_BLOCKS = 16, 400
# Random starts of the iteration, where its blocks become dependent.
MOST_STARTS = 2
# Unknowns up to which a dense solver is used: of a body, of a wave around the axis of one.
DENSE, DENSE_WAVE = 900, 150
# Rows of long vectors at a time, where a second copy of all of them would cost memory.
COPY_ROWS = 16384
# Of the first pass of Cholesky QR: with less, a second pass is orthonormal to rounding (Y. Yamamoto et al.,
# "Roundoff error analysis of the CholeskyQR2 algorithm", ETNA 44, 2015).
LARGEST_FIRST_LOSS = 5 / 64


def weigh(mass: sparse.csr_matrix, vectors: Floats) -> Floats:
    """M x for the mass (n, n) of one axis, or (3 n, 3 n), and vectors (3 n, k), unknown 3 function + axis."""
    return np.asarray(mass @ vectors.reshape(mass.shape[0], -1)).reshape(vectors.shape)


@dataclass(frozen=True)
class Pencil:
    """K u = lambda M u of a free body.

    Attributes
    ----------
    stiffness : (3 n, 3 n), unknown 3 function + axis, in blocks of 3; symmetric, or complex and Hermitian
    mass : (n, n) of one axis, an entry for each block; or (3 n, 3 n), zero for unknowns that are held
    rigid : (3 n, r) M-orthonormal rigid motions
    limits : of its solution
    """

    stiffness: sparse.bsr_matrix
    mass: sparse.csr_matrix
    rigid: Floats
    limits: Limits = NO_LIMITS

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.rigid)

    @property
    def is_small(self) -> bool:
        """Whether a dense solver is used."""
        return self.size <= (DENSE if self.mass.shape != self.stiffness.shape else DENSE_WAVE)

    def random(self, generator: np.random.Generator, columns: int) -> Values:
        """Random vectors (3 n, columns)."""
        vectors = generator.standard_normal((self.size, columns)).astype(self.stiffness.dtype)
        if self.mass.shape == self.stiffness.shape:
            vectors[self.mass.diagonal().real == 0] = 0.0
        return vectors

    @cached_property
    def _mass_rigid(self) -> Floats:
        return weigh(self.mass, self.rigid)

    def without_rigid(self, vectors: Floats) -> Floats:
        """Vectors (3 n, k) made M-orthogonal to the rigid motions, in place."""
        shares = self._mass_rigid.conj().T @ vectors
        for rows in parts(len(vectors), COPY_ROWS):
            vectors[rows] -= self.rigid[rows] @ shares
        return vectors

    def factorise(self, shift: float, *, definite: bool) -> Factorisation:
        """Factors of K - shift M."""
        self.limits.check_time()
        return Factorisation(
            shifted(self.stiffness, self.mass, shift),
            definite=definite,
            most_bytes=self.limits.factor_bytes,
        )

    def residuals(self, pairs: "Eigenpairs") -> Floats:
        """|K u - lambda M u| / |lambda M u|, (k,)."""
        result = np.empty(len(pairs.values))
        for columns in parts(len(result), RIGHT_SIDES_AT_ONCE):
            vectors = np.ascontiguousarray(pairs.vectors[:, columns])
            inertia = weigh(self.mass, vectors) * pairs.values[columns]
            wrong = np.linalg.norm(self.stiffness @ vectors - inertia, axis=0)
            result[columns] = wrong / np.linalg.norm(inertia, axis=0)
        return result


def parts(length: int, size: int) -> Iterator[slice]:
    """Slices of at most `size` that make up a length."""
    return (slice(first, first + size) for first in range(0, length, size))


def low_shift(below: float) -> float:
    """Negative and small: what is far above it is damped most, and K - shift M is definite."""
    return -min(0.05, below / 4)


def count_below(pencil: Pencil, value: float) -> int:
    """Number of elastic eigenvalues below `value`, by the inertia of K - value M.

    Raises
    ------
    SimulationError
        When a pivot vanished, so that the signs of the others prove nothing.
    """
    return pencil.factorise(value, definite=False).negative() - pencil.rigid.shape[1]


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
        corners = inside & (np.arange(len(geometry)) < vertex_count)
        centred = np.where(inside[:, None], geometry, 0.0)
        centred[corners] -= centred[corners].mean(axis=0)
        for axis in range(3):
            translation = np.zeros_like(geometry)
            translation[corners, axis] = 1
            rotation = np.cross(np.eye(3)[axis], centred)
            columns += [translation.ravel(), rotation.ravel()]
    motions = np.stack(columns, axis=1)
    return orthonormalise(motions / np.linalg.norm(motions, axis=0), mass)[0]


def orthonormalise(block: Floats, mass: sparse.csr_matrix) -> tuple[Floats, Floats]:
    """M-orthonormal basis Q (n, k) of the columns and R (k, k) with block = Q R, by Cholesky QR.

    Two passes; three, the first of a shifted Gram matrix, where the columns are nearly dependent (T. Fukaya
    et al., "Shifted Cholesky QR for computing the QR factorization of ill-conditioned matrices", SIAM J. Sci.
    Comput. 42, 2020). The plain form loses orthogonality with the square of the condition number; from some
    1e8 on its factor does not exist, or exists by the luck of rounding, so the loss decides, too.

    Raises
    ------
    numpy.linalg.LinAlgError
        The columns are dependent to rounding.
    """
    gram = _gram(block, mass)
    try:
        better, first = _cholesky_qr(block, gram)
        remaining = _gram(better, mass)
        is_near = bool(np.linalg.norm(remaining - np.eye(len(gram)), 2) <= LARGEST_FIRST_LOSS)
    except np.linalg.LinAlgError:
        is_near = False
    if not is_near:
        shift = 11 * block.size * float(np.finfo(np.float64).eps) * np.linalg.norm(gram, 2)
        shifted, before = _cholesky_qr(block, gram + shift * np.eye(len(gram)))
        better, after = _cholesky_qr(shifted, _gram(shifted, mass))
        first, remaining = after @ before, _gram(better, mass)
    basis, second = _cholesky_qr(better, remaining)
    return basis, second @ first


def _gram(block: Floats, mass: sparse.csr_matrix) -> Floats:
    gram: Floats = block.conj().T @ weigh(mass, block)
    return (gram + gram.conj().T) / 2


def _cholesky_qr(block: Floats, gram: Floats) -> tuple[Floats, Floats]:
    """Q and R by a Gram matrix of the block, which may be shifted."""
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

    def first(self, count: int) -> "Eigenpairs":
        """The lowest of them."""
        return Eigenpairs(self.values[:count], self.vectors[:, :count])


def lowest_elastic(
    pencil: Pencil,
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
    if pencil.is_small:
        values, vectors = _dense_pairs(pencil)
        pair_count = min(int(np.count_nonzero(values < below)), at_most) + 1
        return Eigenpairs(values[:pair_count], vectors[:, :pair_count])
    factors = pencil.factorise(shift, definite=True)
    for attempt in range(MOST_STARTS):
        try:
            lanczos = _Lanczos(pencil, factors, at_most, np.random.default_rng(seed + attempt))
            return lanczos.pairs(shift, below, at_most, tolerance)
        except np.linalg.LinAlgError:  # the block of vectors became dependent
            continue
    raise UnsolvableError(
        "eigenvalue solver",
        f"blocks of vectors became dependent from {MOST_STARTS} random starts of {pencil.size} unknowns",
        "Change the seed.",
    )


def _dense_pairs(pencil: Pencil) -> tuple[Floats, Values]:
    """All elastic eigenvalues and their vectors, ascending, by a dense solver."""
    stiffness, mass = pencil.stiffness.toarray(), pencil.mass.toarray()
    if mass.shape != stiffness.shape:
        mass = np.kron(mass, np.eye(3))
    moving = np.flatnonzero(np.diag(mass).real > 0)
    values, some = linalg.eigh(stiffness[np.ix_(moving, moving)], mass[np.ix_(moving, moving)])
    vectors = np.zeros((pencil.size, len(moving)), some.dtype)
    vectors[moving] = some
    count = pencil.rigid.shape[1]
    return values[count:], vectors[:, count:]


class _Lanczos:
    """Block Lanczos basis of (K - sigma M)^-1 M in the M-orthogonal complement of the rigid motions."""

    def __init__(
        self, pencil: Pencil, factors: Factorisation, at_most: int, generator: np.random.Generator
    ) -> None:
        self._pencil, self._factors = pencil, factors
        start = pencil.without_rigid(factors.solve(pencil.random(generator, BLOCK_COLUMNS)))
        self._next, self._remainder = orthonormalise(start, pencil.mass)
        minimum = min(at_most, 4096) + 4 * BLOCK_COLUMNS
        room = pencil.limits.vector_values / (2 * pencil.size)
        self._capacity = int(max(min(minimum + 2 * min(at_most, 4096), room), minimum, 10 * BLOCK_COLUMNS))
        self._basis = np.empty((pencil.size, self._capacity + BLOCK_COLUMNS), start.dtype, order="F")
        self._mass_basis = np.empty_like(self._basis)
        self._projected = np.zeros((0, 0))

    def pairs(self, shift: float, below: float, at_most: int, tolerance: float) -> Eigenpairs:
        """Pairs as `lowest_elastic` asks for."""
        for step in range(MOST_BLOCKS):
            self._pencil.limits.check_time()
            self._grow()
            width = len(self._projected)
            full = width + BLOCK_COLUMNS > self._capacity
            if width > 16 * BLOCK_COLUMNS and step % 3 and not full:
                continue  # the small eigenproblem is not free either
            theta, ritz = linalg.eigh(self._projected)
            theta, ritz = theta[::-1], ritz[:, ::-1]
            residual = np.linalg.norm(self._remainder @ ritz[-BLOCK_COLUMNS:], axis=0)
            count = _pair_count(theta, shift, below, at_most)
            if count < width and np.all(residual[:count] <= tolerance * theta[:count]):
                return Eigenpairs(shift + 1 / theta[:count], self._basis[:, :width] @ ritz[:, :count])
            if full:
                self._restart(theta, ritz, min(width - BLOCK_COLUMNS, count + 2 * BLOCK_COLUMNS))
        raise UnsolvableError(
            "eigenvalue solver",
            f"no convergence after {MOST_BLOCKS} blocks of {self._pencil.size} unknowns",
            "Lower the frequency limit or the number of modes.",
        )

    def _grow(self) -> None:
        """Add the next block to the basis and find the one after it."""
        width = len(self._projected) + BLOCK_COLUMNS
        block = slice(width - BLOCK_COLUMNS, width)
        self._basis[:, block] = self._next
        self._mass_basis[:, block] = weigh(self._pencil.mass, self._next)
        image = self._pencil.without_rigid(self._factors.solve(self._mass_basis[:, block]))
        coefficients = np.zeros((width, BLOCK_COLUMNS), image.dtype)
        for _ in range(2):  # orthogonalised twice: once leaves rounding errors that grow
            part = self._mass_basis[:, :width].conj().T @ image
            image -= self._basis[:, :width] @ part
            coefficients += part
        grown = np.zeros((width, width), image.dtype)
        grown[:-BLOCK_COLUMNS, :-BLOCK_COLUMNS] = self._projected
        grown[:, -BLOCK_COLUMNS:] = coefficients
        grown[-BLOCK_COLUMNS:, :] = coefficients.conj().T
        self._projected = grown
        self._next, self._remainder = orthonormalise(self._pencil.without_rigid(image), self._pencil.mass)

    def _restart(self, theta: Floats, ritz: Floats, count: int) -> None:
        """Keep the first Ritz vectors alone (thick restart)."""
        width = len(theta)
        self._basis[:, :count] = self._basis[:, :width] @ ritz[:, :count]
        self._mass_basis[:, :count] = self._mass_basis[:, :width] @ ritz[:, :count]
        self._projected = np.diag(theta[:count])


def _pair_count(theta: Floats, shift: float, below: float, at_most: int) -> int:
    """Leading Ritz values that must converge: those below the limit (at most `at_most`) and one beyond."""
    positive = theta > 0
    inside = int(np.count_nonzero(positive & (shift + 1 / np.where(positive, theta, 1.0) < below)))
    return min(inside, at_most) + 1
