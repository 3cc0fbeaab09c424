"""The papers' value at a contact: the mean over the nearest vertices of the cubes."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from objectfolder.errors import InputError

NEAREST = 4


def nearest_vertex_mean(
    nodes: ArrayLike, values: ArrayLike, points: ArrayLike, count: int = NEAREST
) -> NDArray[np.float64]:
    """Unweighted mean of `values` over the `count` nodes nearest to each point.

    Piecewise constant: it jumps where another node becomes one of the nearest, and does not reproduce even
    a field that is linear.

    Parameters
    ----------
    nodes
        (n, 3) metres.
    values
        (n, ...) at the nodes, for instance mode shapes (n, 3, modes).
    points
        (p, 3) metres.

    Returns
    -------
    ndarray
        (p, ...) float64.

    Raises
    ------
    InputError
        Fewer nodes than `count`, or values for another number of nodes.
    """
    nodes = np.asarray(nodes, dtype=np.float64).reshape(-1, 3)
    values = np.asarray(values, dtype=np.float64)
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    if not 1 <= count <= len(nodes):
        raise InputError("nodes", f"{len(nodes)} of them for a mean over {count}", "Use a finer grid.")
    if len(values) != len(nodes):
        raise InputError("values", f"{len(values)} for {len(nodes)} nodes", "Give one a node.")
    nearest = np.asarray(cKDTree(nodes).query(points, k=list(range(1, count + 1)))[1])
    total = np.zeros((len(points), *values.shape[1:]))
    for rank in range(count):
        total += values[nearest[:, rank]]
    return total / count
