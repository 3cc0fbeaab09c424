"""Edges inside a bent solid, bent along with its boundary.

In a thin wall an edge from the outside to the inside is long against the thickness. Were it left straight
between two faces bent alike, it would come out of the wall and fold the elements at it.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from objectfolder.audio.elements.hierarchic import EDGES, reference_integrals
from objectfolder.audio.elements.space import Space
from objectfolder.audio.factorisation import Factorisation

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
FUNCTIONS = 10
# A bend of less than this share of the edge's length is none: straight elements are cheaper.
LEAST_BEND = 2e-3


def bend_along(space: Space, geometry: Floats, boundary_edges: Integers) -> Floats:
    """Geometry whose inner edges follow the bends of the boundary, by harmonic extension.

    The movement off the straight elements is the parabolic function with the boundary's bends and the least
    integral of its squared gradient.

    Parameters
    ----------
    space
        Of order 2 or more.
    geometry
        (function, 3) of which the functions of inner edges are replaced.
    boundary_edges
        (e,) functions of order 2 of the edges of the boundary.
    """
    numbers = space.numbers[:, :FUNCTIONS]
    columns, local = np.unique(numbers[:, 4:], return_inverse=True)
    local = local.reshape(-1, FUNCTIONS - 4)
    inner = ~np.isin(columns, boundary_edges)
    given = geometry[columns]
    given[inner] = 0.0
    if not inner.any() or not given.any():
        result = geometry.copy()
        result[columns[inner]] = 0.0
        return result
    corner = geometry[space.tetrahedra]
    jacobian = corner[:, 1:] - corner[:, :1]
    inverse = np.linalg.inv(jacobian).transpose(0, 2, 1)
    slopes = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
    metric = np.einsum("tkd,tld->tkl", slopes, slopes) * np.abs(np.linalg.det(jacobian))[:, None, None]
    _, products = reference_integrals(2)
    element = np.einsum("ijkl,tkl->tij", products[4:, 4:], metric, optimize=True)
    rows, others = np.broadcast_arrays(local[:, :, None], local[:, None, :])
    matrix = sparse.csr_matrix(
        (element.ravel(), (rows.ravel(), others.ravel())), shape=(len(columns), len(columns))
    )
    right = -(matrix[inner] @ given)
    bends = Factorisation(matrix[inner][:, inner].tocsr(), definite=True).solve(right)
    lengths = np.zeros(len(columns))
    ends = corner[:, EDGES]
    lengths[local] = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    bends[np.linalg.norm(bends, axis=1) < LEAST_BEND * lengths[inner]] = 0.0
    result = geometry.copy()
    result[columns[inner]] = bends
    return result
