"""Elastic modes of a free body: the pencil K u = lambda M u, its count below a limit, and two iterations.

Both work in the M-orthogonal complement of the rigid-body motions, which are known in closed form. From
nothing, modes are found by block Lanczos on (K - sigma M)^-1 M, sigma < 0 small (B. N. Parlett, The Symmetric
Eigenvalue Problem, ch. 13). From near-by vectors, such as a solution in fewer functions, by block inverse
iteration with Rayleigh-Ritz projection (ch. 14). The mass is the same for the three axes and is given once.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

from objectfolder.audio.factorisation import AT_ONCE, Factorisation, shifted
from objectfolder.audio.modes.limits import NO_LIMITS, Limits
from objectfolder.errors import UnsolvableError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
BLOCK, MOST_BLOCKS = 16, 400
# Random starts of the iteration, where its blocks become dependent.
MOST_STARTS = 2
# Unknowns up to which a dense solver is used.
DENSE = 900
# Rounds of inverse iteration for what only has to be nearly right.
NEARLY = 2
# Rows of long vectors at a time, where a second copy of all of them would cost memory.
ROWS = 16384
# Directions of the basis that carry less than this share of the largest one are rounding.
DEPENDENT = 1e-10
# Of the first pass of Cholesky QR: with less, a second pass is orthonormal to rounding (Y. Yamamoto et al.,
# "Roundoff error analysis of the CholeskyQR2 algorithm", ETNA 44, 2015).
LARGEST_FIRST_LOSS = 5 / 64


def weigh(mass: sparse.csr_matrix, vectors: Floats) -> Floats:
    """M x for the mass (n, n) of one axis and vectors (3 n, k), unknown 3 function + axis."""
    return np.asarray(mass @ vectors.reshape(mass.shape[0], -1)).reshape(vectors.shape)


@dataclass(frozen=True)
class Pencil:
    """K u = lambda M u of a free body.

    Attributes
    ----------
    stiffness : (3 n, 3 n), unknown 3 function + axis, in blocks of 3
    mass : (n, n) of one axis, an entry for each block
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

    @cached_property
    def _mass_rigid(self) -> Floats:
        return weigh(self.mass, self.rigid)

    def without_rigid(self, vectors: Floats) -> Floats:
        """Vectors (3 n, k) made M-orthogonal to the rigid motions, in place."""
        shares = self._mass_rigid.T @ vectors
        for rows in _parts(len(vectors), ROWS):
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
        for columns in _parts(len(result), AT_ONCE):
            vectors = np.ascontiguousarray(pairs.vectors[:, columns])
            inertia = weigh(self.mass, vectors) * pairs.values[columns]
            wrong = np.linalg.norm(self.stiffness @ vectors - inertia, axis=0)
            result[columns] = wrong / np.linalg.norm(inertia, axis=0)
        return result


def _parts(length: int, size: int) -> Iterator[slice]:
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
    gram: Floats = block.T @ weigh(mass, block)
    return (gram + gram.T) / 2


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
    if pencil.size <= DENSE:
        values, vectors = linalg.eigh(pencil.stiffness.toarray(), np.kron(pencil.mass.toarray(), np.eye(3)))
        count = pencil.rigid.shape[1]
        values, vectors = values[count:], vectors[:, count:]
        kept = min(int(np.count_nonzero(values < below)), at_most) + 1
        return Eigenpairs(values[:kept], vectors[:, :kept])
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


class _Lanczos:
    """Block Lanczos basis of (K - sigma M)^-1 M in the M-orthogonal complement of the rigid motions."""

    def __init__(
        self, pencil: Pencil, factors: Factorisation, at_most: int, generator: np.random.Generator
    ) -> None:
        self._pencil, self._factors = pencil, factors
        start = pencil.without_rigid(factors.solve(generator.standard_normal((pencil.size, BLOCK))))
        self._next, self._remainder = orthonormalise(start, pencil.mass)
        wanted = min(at_most, 4096) + 4 * BLOCK
        held = pencil.limits.vector_values / (2 * pencil.size)
        self._capacity = int(max(min(wanted + 2 * min(at_most, 4096), held), wanted, 10 * BLOCK))
        self._basis = np.empty((pencil.size, self._capacity + BLOCK), order="F")
        self._mass_basis = np.empty_like(self._basis)
        self._projected = np.zeros((0, 0))

    def pairs(self, shift: float, below: float, at_most: int, tolerance: float) -> Eigenpairs:
        """Wanted pairs, as `lowest_elastic` says."""
        for step in range(MOST_BLOCKS):
            self._pencil.limits.check_time()
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
        raise UnsolvableError(
            "eigenvalue solver",
            f"no convergence after {MOST_BLOCKS} blocks of {self._pencil.size} unknowns",
            "Lower the frequency limit or the number of modes.",
        )

    def _grow(self) -> None:
        """Add the next block to the basis and find the one after it."""
        width = len(self._projected) + BLOCK
        here = slice(width - BLOCK, width)
        self._basis[:, here] = self._next
        self._mass_basis[:, here] = weigh(self._pencil.mass, self._next)
        image = self._pencil.without_rigid(self._factors.solve(self._mass_basis[:, here]))
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
        self._next, self._remainder = orthonormalise(self._pencil.without_rigid(image), self._pencil.mass)

    def _restart(self, theta: Floats, ritz: Floats, kept: int) -> None:
        """Keep the first Ritz vectors alone (thick restart)."""
        width = len(theta)
        self._basis[:, :kept] = self._basis[:, :width] @ ritz[:, :kept]
        self._mass_basis[:, :kept] = self._mass_basis[:, :width] @ ritz[:, :kept]
        self._projected = np.diag(theta[:kept])


def improve(pencil: Pencil, start: Floats, *, shift: float) -> Eigenpairs:
    """Elastic pairs from near-by vectors, by two rounds of `refine`.

    As many as `start` (3 n, k) has, which is overwritten, in ascending order. Enough for what only has to be
    nearly right: an eigenvalue is off by the square of how far its vector is.
    """
    if pencil.size <= DENSE:
        return lowest_elastic(pencil, below=np.inf, at_most=start.shape[1], shift=shift)
    factors = pencil.factorise(shift, definite=True)
    return refine(pencil, factors, shift, start, below=np.inf, tolerance=0.0, rounds=NEARLY)[0]


def refine(
    pencil: Pencil,
    factors: Factorisation,
    shift: float,
    start: Floats,
    *,
    below: float,
    tolerance: float,
    rounds: int,
) -> tuple[Eigenpairs, float]:
    """Ritz pairs of vectors and their images under (K - shift M)^-1 M, round after round.

    Each round solves once for all vectors. The first takes the best of the images, further ones the best of
    both blocks. Directions of earlier rounds, as in locally optimal conjugate gradients, would cost more than
    they save: a round alone takes off more than nine tenths of the error. Two blocks as large as the vectors
    are in memory.

    Parameters
    ----------
    factors
        Of K - shift M; the shift may lie between eigenvalues, and those on either side of it that `start`
        has not are what makes it slow.
    start
        (3 n, k), overwritten; at most as many pairs are returned.
    below
        Ritz values below this must have settled.
    tolerance
        Relative change of an eigenvalue by the last round, at most, for no further one.
    rounds
        Greatest number of rounds.

    Returns
    -------
    pairs, change
        Largest relative change of eigenvalues below the limit by the last round: a bound on what is still
        wrong where a round takes off at least half of the error. Infinite after one round.
    """
    vectors = _unit(pencil, start)
    values = np.zeros(0)
    change = np.inf
    for turn in range(rounds):
        pencil.limits.check_time()
        image = _Image.of(pencil, factors, vectors)
        found, vectors = _best_of_both(shift, values, vectors, image)
        del image  # its memory, before the next one
        if turn > 0:
            shared = np.flatnonzero(found[: len(values)] < below)
            change = float(np.abs(values[shared] / found[shared] - 1).max(initial=0.0))
        values = found
        if change <= tolerance:
            break
    return Eigenpairs(values, vectors), change


def _unit(pencil: Pencil, vectors: Floats) -> Floats:
    """Vectors (3 n, k) without rigid motions and of unit mass, in place."""
    vectors = pencil.without_rigid(vectors)
    for columns in _parts(vectors.shape[1], AT_ONCE):
        part = np.ascontiguousarray(vectors[:, columns])
        vectors[:, columns] = part / np.sqrt(np.einsum("ij,ij->j", part, weigh(pencil.mass, part)))
    return vectors


@dataclass(frozen=True)
class _Image:
    """Images of vectors V (3 n, k) under (K - shift M)^-1 M, of unit mass and without rigid motions.

    M times vectors is made for a few columns at a time: it would take as much memory as they.

    Attributes
    ----------
    vectors : (3 n, k) the images W
    gram : (k, k) W^T M W
    across : (k, k) V^T M W
    size : (k,) factors that made them of unit mass
    """

    vectors: Floats
    gram: Floats
    across: Floats
    size: Floats

    @classmethod
    def of(cls, pencil: Pencil, factors: Factorisation, vectors: Floats) -> "_Image":
        """The images of vectors."""
        image, count = np.empty(vectors.shape), vectors.shape[1]
        for columns in _parts(count, AT_ONCE):
            image[:, columns] = factors.solve(weigh(pencil.mass, np.ascontiguousarray(vectors[:, columns])))
        pencil.without_rigid(image)
        gram, across = np.empty((count, count)), np.empty((count, count))
        for columns in _parts(count, AT_ONCE):
            weighed = weigh(pencil.mass, np.ascontiguousarray(image[:, columns]))
            gram[:, columns], across[:, columns] = image.T @ weighed, vectors.T @ weighed
        size = 1 / np.sqrt(np.diag(gram))
        image *= size
        return cls(image, gram * size * size[:, None], across * size, size)


def _best_of_both(shift: float, values: Floats, vectors: Floats, image: _Image) -> tuple[Floats, Floats]:
    """Ritz values and vectors of vectors and their images, of the images alone where no values are known yet.

    K is never multiplied by: K image = shift M image + M vectors, each column scaled by `size`. The result is
    written over `vectors`.
    """
    stiff = shift * image.gram + image.across.T * image.size
    count = len(values)
    if count == 0:
        found, weights = _ritz(image.gram, stiff)
        return found, _combined(vectors, (image.vectors, weights))
    corner = shift * image.across + image.size * np.eye(count)
    both = np.block([[np.eye(count), image.across], [image.across.T, image.gram]])
    stiff_both = np.block([[np.diag(values), corner], [corner.T, stiff]])
    found, weights = _ritz(both, stiff_both)
    one, other = weights[:count, :count], weights[count:, :count]
    return found[:count], _combined(vectors, (vectors, one), (image.vectors, other))


def _combined(into: Floats, *terms: tuple[Floats, Floats]) -> Floats:
    """Sum of blocks (n, a) times weights (a, k), k <= a, written over the first columns of a block."""
    into = into[:, : terms[0][1].shape[1]]
    for rows in _parts(len(into), ROWS):
        into[rows] = sum(block[rows] @ weights for block, weights in terms)
    return into


def _ritz(gram: Floats, stiff: Floats) -> tuple[Floats, Floats]:
    """Ritz values, ascending, and weights (basis, kept) of a basis that may be nearly dependent."""
    scale = 1 / np.sqrt(np.diag(gram))
    weights, axes = linalg.eigh((gram + gram.T) / 2 * scale * scale[:, None])
    kept = weights > DEPENDENT * weights[-1]
    basis = scale[:, None] * axes[:, kept] / np.sqrt(weights[kept])
    projected = basis.T @ (stiff + stiff.T) @ basis / 2
    values, ritz = linalg.eigh((projected + projected.T) / 2)
    return values, basis @ ritz


def _wanted(theta: Floats, shift: float, below: float, at_most: int) -> int:
    """Leading Ritz values that must converge: those below the limit (at most `at_most`) and one beyond."""
    positive = theta > 0
    inside = int(np.count_nonzero(positive & (shift + 1 / np.where(positive, theta, 1.0) < below)))
    return min(inside, at_most) + 1
