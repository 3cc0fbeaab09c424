"""Sheared contacts by a dense matrix and a Gauss-Seidel method: nothing is shared with the solver.

The matrix holds Cerruti's point loads, summed over parts of each cell. Each sweep gives every cell the
traction at which it sticks while the others stay, cut to Coulomb's limit, until none changes (F. Jourdan,
P. Alart & M. Jean 1998, Comput. Methods Appl. Mech. Engrg. 155). The shift is given, and the force follows.
"""

import numpy as np

PARTS = 8


def cerruti(points: np.ndarray, pitch: float, poisson_ratio: float, youngs_modulus_pa: float) -> np.ndarray:
    """Displacement (n, n, 2, 2) of the centres (n, 2) of square cells by tractions on them, m/Pa."""
    shear = youngs_modulus_pa / (2 * (1 + poisson_ratio))
    node, weight = np.polynomial.legendre.leggauss(PARTS)
    matrix = np.zeros((len(points), len(points), 2, 2))
    # Quarters of a cell: the singular centre lies at their corners.
    for quarter in ((-0.25, -0.25), (-0.25, 0.25), (0.25, -0.25), (0.25, 0.25)):
        for i, first in enumerate(node):
            for j, second in enumerate(node):
                at = np.array(quarter) + np.array([first, second]) / 4
                away = points[:, None] - points[None] - at * pitch
                r = np.sqrt((away**2).sum(axis=-1))[..., None, None]
                kernel = (1 - poisson_ratio) * np.eye(2) / r
                kernel = kernel + poisson_ratio * away[..., :, None] * away[..., None, :] / r**3
                matrix += weight[i] * weight[j] / 16 * pitch**2 * kernel
    return matrix / (2 * np.pi * shear)


def sheared(matrix: np.ndarray, limit: np.ndarray, shift: np.ndarray, tolerance: float = 1e-9) -> np.ndarray:
    """Tractions (n, 2) under a limit (n,) where the object has shifted by (2,)."""
    traction = np.zeros((len(limit), 2))
    for _ in range(2000):
        largest = 0.0
        for cell in range(len(limit)):
            own = matrix[cell, cell, 0, 0]
            left = shift - np.einsum("nij,nj->i", matrix[cell], traction)
            trial = traction[cell] + left / own
            length = np.hypot(*trial)
            new = trial * min(1.0, limit[cell] / length) if length > 0 else trial
            largest = max(largest, float(np.abs(new - traction[cell]).max()))
            traction[cell] = new
        if largest <= tolerance * limit.max():
            return traction
    raise AssertionError("the sweeps did not converge")
