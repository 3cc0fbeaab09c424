"""Lagrange spaces of order 1 to 3 on straight-sided tetrahedra.

Nodes of order p sit at barycentric coordinates alpha / p, alpha a multi-index with sum p, and the basis is
Silvester's product  N_alpha(l) = prod_i prod_{m < alpha_i} (p l_i - m) / (m + 1)
(P. Silvester, "High-order polynomial triangular finite elements", Int. J. Engng Sci. 7, 1969).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_jacobi

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@cache
def multi_indices(order: int) -> tuple[tuple[int, int, int, int], ...]:
    """Multi-indices of the element's nodes: the four corners first, then edges, then faces."""
    if order not in (1, 2, 3):
        raise ValueError(f"order {order}: tetrahedra of order 1, 2 and 3 are implemented")
    every = [
        (a, b, c, order - a - b - c)
        for a in range(order, -1, -1)
        for b in range(order - a, -1, -1)
        for c in range(order - a - b, -1, -1)
    ]
    return tuple(sorted(every, key=lambda alpha: (sum(x > 0 for x in alpha), [-x for x in alpha])))


def basis(barycentric: Floats, order: int) -> tuple[Floats, Floats]:
    """Values (n, nodes) and derivatives (n, nodes, 4) by each barycentric coordinate at (n, 4) points.

    The four coordinates are treated as independent; contracting the derivatives with their (constant)
    spatial gradients gives the gradient of the basis.
    """
    scaled = order * np.asarray(barycentric, dtype=np.float64)
    factor = np.ones((order + 1, *scaled.shape))
    slope = np.zeros_like(factor)
    for m in range(order):
        factor[m + 1] = factor[m] * (scaled - m) / (m + 1)
        slope[m + 1] = (slope[m] * (scaled - m) + factor[m] * order) / (m + 1)
    alphas = np.array(multi_indices(order))
    axis = np.arange(4)
    factors = factor[alphas[:, None, :], np.arange(len(scaled))[None, :, None], axis]  # (nodes, n, 4)
    slopes = slope[alphas[:, None, :], np.arange(len(scaled))[None, :, None], axis]
    derivatives = np.stack(
        [slopes[..., k] * np.prod(np.delete(factors, k, axis=-1), axis=-1) for k in range(4)], axis=-1
    )
    return np.prod(factors, axis=-1).T, np.swapaxes(derivatives, 0, 1)


@cache
def reference_integrals(order: int) -> tuple[Floats, Floats]:
    """Means over a tetrahedron of N_i N_j, (nodes, nodes), and of dN_i/dl_k dN_j/dl_l, (nodes, nodes, 4, 4).

    Exact: a collapsed Gauss-Jacobi rule of degree 2 order + 1.
    """
    (x, wx), (y, wy), (z, wz) = (roots_jacobi(order + 1, power, 0) for power in (2, 1, 0))
    x, y, z = ((1 + t) / 2 for t in (x, y, z))
    a, b, c = np.meshgrid(x, y, z, indexing="ij")
    weight = np.einsum("i,j,k->ijk", wx, wy, wz).ravel()
    l1, l2, l3 = a.ravel(), (b * (1 - a)).ravel(), (c * (1 - b) * (1 - a)).ravel()
    points = np.stack([1 - l1 - l2 - l3, l1, l2, l3], axis=-1)
    value, derivative = basis(points, order)
    weight = weight / weight.sum()
    return (
        np.einsum("q,qi,qj->ij", weight, value, value),
        np.einsum("q,qik,qjl->ijkl", weight, derivative, derivative),
    )


@dataclass(frozen=True)
class LagrangeSpace:
    """Continuous piecewise polynomials on a tetrahedral mesh.

    Attributes
    ----------
    vertices : (v, 3) float64
    tetrahedra : (t, 4) int64, positively oriented
    order : 1, 2 or 3
    nodes : (t, nodes of an element) int64, global number of each local node
    node_count : number of global nodes
    """

    vertices: Floats
    tetrahedra: Integers
    order: int
    nodes: Integers
    node_count: int

    @classmethod
    def on(cls, vertices: Floats, tetrahedra: Integers, order: int) -> "LagrangeSpace":
        """Number the nodes: a node is the same in two elements when its weighted vertices are the same."""
        alphas = np.array(multi_indices(order))
        if len(vertices) >= 2**19:
            raise ValueError(f"{len(vertices)} vertices: node numbering holds fewer than 524288")
        # At most three weights are positive for order <= 3: three 21-bit fields, sorted, identify a node.
        fields = np.where(alphas > 0, tetrahedra[:, None, :] * 4 + alphas, 0)
        fields = np.sort(fields, axis=-1)[..., 1:]
        key = (fields[..., 0] << 42) | (fields[..., 1] << 21) | fields[..., 2]
        unique, nodes = np.unique(key, return_inverse=True)
        return cls(vertices, tetrahedra, order, nodes.reshape(key.shape), len(unique))

    def gradients_and_volumes(self) -> tuple[Floats, Floats]:
        """Gradients of the barycentric coordinates (t, 4, 3) and volumes (t,)."""
        corner = self.vertices[self.tetrahedra]
        edges = corner[:, 1:] - corner[:, :1]
        inverse = np.linalg.inv(edges)  # rows of `edges` are x_k - x_0; columns of its inverse are gradients
        rest = np.swapaxes(inverse, 1, 2)
        gradients = np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1)
        return gradients, np.linalg.det(edges) / 6

    def node_positions(self) -> Floats:
        """Position of each node, (node_count, 3)."""
        weights = np.array(multi_indices(self.order)) / self.order
        positions = np.empty((self.node_count, 3))
        positions[self.nodes] = np.einsum("ik,tkd->tid", weights, self.vertices[self.tetrahedra])
        return positions
