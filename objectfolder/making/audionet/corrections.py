"""What smooth fields miss, at the vertices of the surface and linear across its faces.

The modes of a solver have kinks between elements, and where a solid lacks a thin web of the surface they jump
from one of its edges to the other. No smooth function has that. A correction of a vertex is a hat function; a
little Tikhonov regularisation holds those that few points see, the differences along edges and the size.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu

from objectfolder.making.audionet.least_squares import Basis, Data, predict
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
ALONG_EDGES = 0.1  # weight of differences over that of sizes


@dataclass(frozen=True)
class Fields:
    """Fields on a surface: coefficients (controls, columns) and corrections (vertices, columns)."""

    basis: Basis
    coefficients: Floats
    corrections: Floats | None = None

    def at(self, data: Data) -> Floats:
        """Values (n, columns) at the points of `data`."""
        smooth = predict(self.basis, self.coefficients, data)
        if self.corrections is None:
            return smooth
        return smooth + _hats(self.basis.kernel.surface, data) @ self.corrections

    def corrected(self, data: Data, weights: Sequence[float]) -> list["Fields"]:
        """These with what they miss at the points of `data`, for each weight of the regularisation."""
        surface = self.basis.kernel.surface
        functions = diags_array(data.weights) @ _hats(surface, data)
        misfit = functions.T @ (data.weights[:, None] * (data.values - self.at(data)))
        normal, penalty = functions.T @ functions, _penalty(surface)
        solvers = (splu((normal + weight * penalty).tocsc()) for weight in weights)
        return [replace(self, corrections=np.asarray(solver.solve(misfit))) for solver in solvers]


def _hats(surface: Surface, data: Data) -> csr_array:
    """Hat functions (n, vertices) at points."""
    points, vertices = np.repeat(np.arange(len(data.face)), 3), surface.faces[data.face].ravel()
    shape = len(data.face), len(surface.vertices)
    return coo_array((data.barycentric.ravel(), (points, vertices)), shape=shape).tocsr()


def _penalty(surface: Surface) -> csr_array:
    """Quadratic form (vertices, vertices): squares of sizes, and some of differences along edges."""
    edges = surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    rows, signs = np.repeat(np.arange(len(edges)), 2), np.tile([1.0, -1.0], len(edges))
    shape = len(edges), len(surface.vertices)
    differences = coo_array((signs, (rows, edges.ravel())), shape=shape).tocsr()
    return (eye_array(len(surface.vertices)) + ALONG_EDGES * (differences.T @ differences)).tocsr()
