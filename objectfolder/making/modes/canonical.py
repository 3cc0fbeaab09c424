"""One basis for each repeated eigenvalue, whatever basis a solver happened to return.

Modes of equal frequency may be mixed by any rotation, and any mode may change its sign: a symmetric body
gives another set of mode shapes with every seed of the solver. Within each cluster of equal eigenvalues the
basis is fixed here as the eigenvectors of a generic quadratic functional of the displacement,

    A_ij = sum_p w_p s(x_p) (phi_i(x_p) . d) (phi_j(x_p) . d),

in ascending order, and the sign of every mode by a generic linear functional. Both are integrals over the
given points, so they move smoothly with the modes and the points. The density s has kinks along planes: a
pair that varies as cos(m theta) and sin(m theta) is told apart by its component of order 2m alone, and kinks
leave that of the order 1/m^2 where a smooth density would leave next to nothing.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

RELATIVE_TOLERANCE = 1e-4
"""Eigenvalues this near to one another count as one: 0.09 cents in frequency."""

FUNCTIONALS = 6
PLANE_COUNT = 5
# A functional that parts the eigenvectors by this share of its size will do; else the best of all is taken.
ENOUGH = 0.02
# The real root of x^4 = x + 1: its inverse powers make a low-discrepancy sequence in three dimensions
# (Roberts' generalised golden ratio), numbers that no library version changes.
RATIO = 1.2207440846057596


@dataclass(frozen=True)
class Functional:
    """A generic density on the unit ball: directions (plane, 3), offsets (plane,), weights (plane,)."""

    axis: Floats
    normals: Floats
    offsets: Floats

    def density(self, x: Floats) -> Floats:
        """Sum over the planes of |n . x - c|, (p,) at points (p, 3)."""
        return np.asarray(np.abs(x @ self.normals.T - self.offsets).sum(axis=1))


def clusters(eigenvalues: ArrayLike, tolerance: float = RELATIVE_TOLERANCE) -> list[slice]:
    """Ranges of ascending eigenvalues of which each is within the tolerance of the one before.

    Parameters
    ----------
    eigenvalues
        (m,) ascending, positive.
    tolerance
        Relative difference of two neighbours that count as equal.

    Returns
    -------
    list of slice
        Together they cover all of the m eigenvalues, single ones included.
    """
    values = np.asarray(eigenvalues, dtype=np.float64)
    apart = np.flatnonzero(np.diff(values) > tolerance * np.abs(values[1:])) + 1
    edges = [0, *apart.tolist(), len(values)]
    return [slice(start, stop) for start, stop in pairwise(edges) if stop > start]


def canonical_rotation(
    eigenvalues: ArrayLike,
    shapes: ArrayLike,
    points: ArrayLike,
    weights: ArrayLike | None = None,
) -> Floats:
    """Find the rotation of each cluster, and the sign of each mode, that makes the basis canonical.

    Parameters
    ----------
    eigenvalues
        (m,) ascending. A cluster should be whole: a band that ends within one has no canonical basis.
    shapes
        (p, 3, m) mode shapes at points of the body.
    points
        (p, 3) those points; hundreds at least, and the same ones wherever results shall be equal.
    weights
        (p,) quadrature weights; equal ones by default.

    Returns
    -------
    ndarray
        (m, m) orthogonal and block-diagonal. Canonical shapes are ``shapes @ rotation``, and so are nodal
        vectors; scaling, moving or resampling the points evenly changes it smoothly or not at all.

    Raises
    ------
    ValueError
        Shapes that do not fit the eigenvalues and points, or are not finite.
    """
    values = np.asarray(eigenvalues, dtype=np.float64)
    u = np.asarray(shapes, dtype=np.float64)
    x = np.asarray(points, dtype=np.float64)
    if u.shape != (len(x), 3, len(values)) or x.shape != (len(x), 3):
        raise ValueError(f"shapes {u.shape} at points {x.shape} are not those of {len(values)} eigenvalues")
    if not (np.isfinite(u).all() and np.isfinite(x).all()):
        raise ValueError("mode shapes and points must be finite")
    rotation = np.eye(len(values))
    if u.size == 0:
        return rotation
    w = np.full(len(x), 1.0) if weights is None else np.asarray(weights, dtype=np.float64)
    w = w / w.sum()
    centred = x - w @ x
    centred = centred / max(float(np.sqrt(w @ np.sum(centred**2, axis=1))), 1e-300)
    functionals = [_functional(index) for index in range(FUNCTIONALS)]
    densities = [w * functional.density(centred) for functional in functionals]
    for cluster in clusters(values):
        block = u[:, :, cluster]
        turn = _diagonalise(block, functionals, densities) if block.shape[2] > 1 else np.eye(1)
        rotation[cluster, cluster] = turn * _signs(block @ turn, functionals, densities)
    return rotation


def _diagonalise(block: Floats, functionals: list[Functional], densities: list[Floats]) -> Floats:
    """Eigenvectors (k, k) of the first functional that parts them well, or of the one that does best."""
    best, parted = np.eye(block.shape[2]), -1.0
    for functional, density in zip(functionals, densities, strict=True):
        along = np.einsum("k,pkm->pm", functional.axis, block)
        form = along.T @ (along * density[:, None])
        levels, vectors = np.linalg.eigh((form + form.T) / 2)
        gap = float(np.diff(levels).min() / max(float(levels[-1] - levels[0]), 1e-300)) * (len(levels) - 1)
        spread = float(levels[-1] - levels[0]) / max(float(np.abs(levels).max()), 1e-300)
        share = min(gap, spread)
        if share > parted:
            best, parted = vectors, share
        if share >= ENOUGH:
            break
    return np.asarray(best, dtype=np.float64)


def _signs(block: Floats, functionals: list[Functional], densities: list[Floats]) -> Floats:
    """+1 or -1 (k,) so that the first linear functional of some size, or else the largest, is positive."""
    size = np.sqrt(np.einsum("p,pkm->m", densities[0], block**2) * densities[0].sum())
    values = np.array(
        [
            np.einsum("p,k,pkm->m", density, functional.axis, block)
            for functional, density in zip(functionals, densities, strict=True)
        ]
    ) / np.maximum(size, 1e-300)
    large = np.abs(values) >= ENOUGH
    chosen = np.where(large.any(axis=0), large.argmax(axis=0), np.abs(values).argmax(axis=0))
    return np.where(values[chosen, np.arange(values.shape[1])] < 0, -1.0, 1.0)


def _functional(index: int) -> Functional:
    """The same numbers always; no two planes or axes parallel, none through the centre."""
    start = index * (PLANE_COUNT + 1) + 1
    numbers = np.arange(start, start + PLANE_COUNT + 1)
    ratio = RATIO ** -np.arange(1, 4)
    height, turn, offset = np.modf(numbers[:, None] * ratio + 0.5)[0].T
    z = 2 * height - 1
    radius, angle = np.sqrt(1 - z**2), 2 * np.pi * turn
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    return Functional(directions[0], directions[1:], 1.4 * offset[1:] - 0.7)
