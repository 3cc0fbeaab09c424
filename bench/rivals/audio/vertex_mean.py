"""The papers' value at a contact: the mean over the nearest vertices of the cubes."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

NEAREST = 4


def nearest_vertex_mean(
    nodes: NDArray[np.float64], values: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Unweighted mean (p, ...) of values (n, ...) over the four nodes (n, 3) nearest to each point (p, 3).

    Piecewise constant: it jumps where another node becomes one of the nearest, and does not reproduce even
    a field that is linear.
    """
    nearest = np.asarray(cKDTree(nodes).query(points, k=NEAREST)[1])
    total = np.zeros((len(points), *values.shape[1:]))
    for rank in range(NEAREST):
        total += values[nearest[:, rank]]
    return total / NEAREST
