"""Fields on a surface as coefficients of functions that are orthonormal and ordered from smooth to fine.

The space is spanned by the covariances with the control points, in an order in which every leading part of
them is spread out. Orthonormalised in that order over the control points (covariance matrix G = Q R, values
V = G a = Q c), the first functions are the smoothest, and each further one has what the ones before cannot
say. Errors of the coefficients c are errors of the field of the same size, wherever they are: they may be
rounded with one step. A field is recovered by a = R^-1 c; Q is never needed.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def triangular_factor(covariance: Floats, ridge: float) -> Floats:
    """R (k, k) of the covariance of control points plus ridge, with a positive diagonal: it is unique."""
    regular = covariance + ridge * np.eye(len(covariance))
    factor = np.linalg.qr(regular, mode="r")
    return np.asarray(factor * np.where(np.diag(factor) < 0, -1.0, 1.0)[:, None])


def solve_triangular(factor: Floats, right: Floats) -> Floats:
    """R^-1 right for upper triangular R (k, k), by halves: products do nearly all of the work."""
    if len(factor) <= 96:
        return np.asarray(np.linalg.solve(factor, right))
    half = len(factor) // 2
    lower = solve_triangular(factor[half:, half:], right[half:])
    upper = solve_triangular(factor[:half, :half], right[:half] - factor[:half, half:] @ lower)
    return np.concatenate([upper, lower])
