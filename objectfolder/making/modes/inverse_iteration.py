"""Elastic pairs from near-by vectors, such as a solution in fewer functions, by block inverse iteration.

Each round projects by Rayleigh and Ritz (B. N. Parlett, The Symmetric Eigenvalue Problem, ch. 14).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from objectfolder.making.factorisation import RIGHT_SIDES_AT_ONCE, Factorisation
from objectfolder.making.modes.eigen import COPY_ROWS, Eigenpairs, Pencil, lowest_elastic, parts, weigh

Floats = NDArray[np.float64]
# Rounds for what only has to be nearly right.
NEARLY = 2
# Directions of the basis that carry less than this share of the largest one are rounding.
DEPENDENT = 1e-10


def improve(pencil: Pencil, start: Floats, *, shift: float) -> Eigenpairs:
    """Elastic pairs from near-by vectors, by two rounds of `refine`.

    As many as `start` (3 n, k) has, which is overwritten, in ascending order. Enough for what only has to be
    nearly right: an eigenvalue is off by the square of how far its vector is.
    """
    if pencil.is_small:
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
        ritz_values, vectors = _rayleigh_ritz(shift, values, vectors, image)
        del image  # its memory, before the next one
        if turn > 0:
            shared = np.flatnonzero(ritz_values[: len(values)] < below)
            change = float(np.abs(values[shared] / ritz_values[shared] - 1).max(initial=0.0))
        values = ritz_values
        if change <= tolerance:
            break
    return Eigenpairs(values, vectors), change


def _unit(pencil: Pencil, vectors: Floats) -> Floats:
    """Vectors (3 n, k) without rigid motions and of unit mass, in place."""
    vectors = pencil.without_rigid(vectors)
    for columns in parts(vectors.shape[1], RIGHT_SIDES_AT_ONCE):
        part = np.ascontiguousarray(vectors[:, columns])
        vectors[:, columns] = part / np.sqrt(
            np.einsum("ij,ij->j", part.conj(), weigh(pencil.mass, part)).real
        )
    return vectors


@dataclass(frozen=True)
class _Image:
    """Images of vectors V (3 n, k) under (K - shift M)^-1 M, of unit mass and without rigid motions.

    M times vectors is made for a few columns at a time: it would take as much memory as they.

    Attributes
    ----------
    vectors : (3 n, k) the images W
    gram : (k, k) W^H M W
    across : (k, k) V^H M W
    size : (k,) factors that made them of unit mass
    """

    vectors: Floats
    gram: Floats
    across: Floats
    size: Floats

    @classmethod
    def of(cls, pencil: Pencil, factors: Factorisation, vectors: Floats) -> "_Image":
        """The images of vectors."""
        image, count = np.empty_like(vectors), vectors.shape[1]
        for columns in parts(count, RIGHT_SIDES_AT_ONCE):
            image[:, columns] = factors.solve(weigh(pencil.mass, np.ascontiguousarray(vectors[:, columns])))
        pencil.without_rigid(image)
        gram, across = (np.empty((count, count), vectors.dtype) for _ in range(2))
        for columns in parts(count, RIGHT_SIDES_AT_ONCE):
            weighed = weigh(pencil.mass, np.ascontiguousarray(image[:, columns]))
            gram[:, columns], across[:, columns] = image.conj().T @ weighed, vectors.conj().T @ weighed
        size = 1 / np.sqrt(np.diag(gram).real)
        image *= size
        return cls(image, gram * size * size[:, None], across * size, size)


def _rayleigh_ritz(shift: float, values: Floats, vectors: Floats, image: _Image) -> tuple[Floats, Floats]:
    """Ritz values and vectors of vectors and their images, of the images alone where no values are known yet.

    K is never multiplied by: K image = shift M image + M vectors, each column scaled by `size`. The result is
    written over `vectors`.
    """
    stiff = shift * image.gram + image.across.conj().T * image.size
    count = len(values)
    if count == 0:
        ritz_values, weights = _ritz(image.gram, stiff)
        return ritz_values, _combined(vectors, (image.vectors, weights))
    corner = shift * image.across + image.size * np.eye(count)
    joint_gram = np.block([[np.eye(count), image.across], [image.across.conj().T, image.gram]])
    joint_stiffness = np.block([[np.diag(values), corner], [corner.conj().T, stiff]])
    ritz_values, weights = _ritz(joint_gram, joint_stiffness)
    upper, lower = weights[:count, :count], weights[count:, :count]
    return ritz_values[:count], _combined(vectors, (vectors, upper), (image.vectors, lower))


def _combined(into: Floats, *terms: tuple[Floats, Floats]) -> Floats:
    """Sum of blocks (n, a) times weights (a, k), k <= a, written over the first columns of a block."""
    into = into[:, : terms[0][1].shape[1]]
    for rows in parts(len(into), COPY_ROWS):
        into[rows] = sum(block[rows] @ weights for block, weights in terms)
    return into


def _ritz(gram: Floats, stiff: Floats) -> tuple[Floats, Floats]:
    """Ritz values, ascending, and weights (basis, independent) of a basis that may be nearly dependent."""
    scale = 1 / np.sqrt(np.diag(gram).real)
    weights, axes = linalg.eigh((gram + gram.conj().T) / 2 * scale * scale[:, None])
    independent = weights > DEPENDENT * weights[-1]
    basis = scale[:, None] * axes[:, independent] / np.sqrt(weights[independent])
    projected = basis.conj().T @ (stiff + stiff.conj().T) @ basis / 2
    values, ritz = linalg.eigh((projected + projected.conj().T) / 2)
    return values, basis @ ritz
