"""Eigenpairs from near-by ones: block inverse iteration with Rayleigh-Ritz projection.

A solution in fewer functions is a good start. Each round solves (K - sigma M) Y = M X once for all vectors
and takes the best of both blocks (B. N. Parlett, The Symmetric Eigenvalue Problem, ch. 14). K is never
multiplied by: K Y = sigma M Y + M X. Directions of earlier rounds, as in locally optimal conjugate gradients,
would cost more than they save: a round alone takes off more than nine tenths of the error.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

from objectfolder.audio.factorisation import Factorisation

Floats = NDArray[np.float64]
# Directions of the basis that carry less than this share of the largest one are rounding.
DEPENDENT = 1e-10


def weigh(mass: sparse.csr_matrix, vectors: Floats) -> Floats:
    """M x for the mass (n, n) of one axis and vectors (3 n, k), unknown 3 function + axis."""
    return np.asarray(mass @ vectors.reshape(mass.shape[0], -1)).reshape(vectors.shape)


def refine(
    factors: Factorisation,
    shift: float,
    mass: sparse.csr_matrix,
    rigid: Floats,
    start: Floats,
    *,
    below: float,
    tolerance: float,
    rounds: int,
) -> tuple[Floats, Floats, float]:
    """Ritz pairs of the vectors and their images under (K - shift M)^-1 M, round after round.

    Parameters
    ----------
    factors
        Of K - shift M; the shift may lie between eigenvalues, and those on either side of it that `start`
        has not are what makes it slow.
    mass
        (n, n) of one axis.
    rigid
        M-orthonormal null vectors, (3 n, r); M-orthogonal to what is returned.
    start
        (3 n, k).
    below
        Ritz values below this must have settled.
    tolerance
        Relative change of an eigenvalue by the last round, at most, for no further one.
    rounds
        Greatest number of rounds.

    Returns
    -------
    values, vectors
        (k,) ascending, at most as many as `start` has, and (3 n, k) with u^T M u = 1.
    change
        Largest relative change of those below the limit by the last round: a bound on what is still wrong
        where a round takes off at least half of the error. Infinite after one round.
    """
    mass_rigid = weigh(mass, rigid)
    vectors = start - rigid @ (mass_rigid.T @ start)
    weighed = weigh(mass, vectors)
    size = 1 / np.sqrt(np.einsum("ij,ij->j", vectors, weighed))
    vectors, weighed = vectors * size, weighed * size
    values = np.zeros(0)
    change = np.inf
    for turn in range(rounds):
        image = factors.solve(weighed)
        image -= rigid @ (mass_rigid.T @ image)
        image_weighed = weigh(mass, image)
        size = 1 / np.sqrt(np.einsum("ij,ij->j", image, image_weighed))
        image *= size
        image_weighed *= size
        gram = image.T @ image_weighed
        # K image = shift M image + M vectors, each column scaled.
        across = vectors.T @ image_weighed
        stiff = shift * gram + across.T * size
        if turn == 0:
            found, first = _ritz(gram, stiff)
            vectors, weighed = image @ first, image_weighed @ first
        else:
            count = len(values)
            corner = shift * across + size * np.eye(count)
            both = np.block([[np.eye(count), across], [across.T, gram]])
            stiff_both = np.block([[np.diag(values), corner], [corner.T, stiff]])
            found, weights = _ritz(both, stiff_both)
            found, weights = found[:count], weights[:, :count]
            one, other = weights[:count], weights[count:]
            vectors = vectors @ one
            vectors += image @ other
            weighed = weighed @ one
            weighed += image_weighed @ other
            inside = found < below
            shared = np.flatnonzero(inside[: len(values)])
            change = float(np.abs(values[shared] / found[shared] - 1).max(initial=0.0))
        values = found
        if change <= tolerance:
            break
    return values, vectors, change


def _ritz(gram: Floats, stiff: Floats) -> tuple[Floats, Floats]:
    """Ritz values, ascending, and weights (basis, kept) of a basis that may be nearly dependent."""
    scale = 1 / np.sqrt(np.diag(gram))
    weights, axes = linalg.eigh((gram + gram.T) / 2 * scale * scale[:, None])
    kept = weights > DEPENDENT * weights[-1]
    basis = scale[:, None] * axes[:, kept] / np.sqrt(weights[kept])
    projected = basis.T @ (stiff + stiff.T) @ basis / 2
    values, ritz = linalg.eigh((projected + projected.T) / 2)
    return values, basis @ ritz
