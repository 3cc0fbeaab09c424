"""Isotropic linear elasticity on tetrahedra: mass and stiffness of a free body, in dimensionless form.

With lengths in units of L, speeds in units of the shear speed c_s = sqrt(mu / rho) and density 1, the weak
form is

    lambda' (div u)(div v) + 2 eps(u) : eps(v)  =  eta^2 u . v,     lambda' = 2 nu / (1 - 2 nu),

so that eta = omega L / c_s: neither the size nor the unit of anything enters the eigenproblem.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from objectfolder.audio.lagrange import LagrangeSpace, reference_integrals

Floats = NDArray[np.float64]


def element_stiffness(space: LagrangeSpace, poisson_ratio: float, elements: slice) -> Floats:
    """Stiffness blocks of the chosen elements, (t, nodes, nodes, 3, 3) float64.

    Raises
    ------
    ValueError
        For a Poisson ratio outside (-1, 0.5), where the isotropic energy is not positive.
    """
    if not -1 < poisson_ratio < 0.5:
        raise ValueError(f"Poisson ratio {poisson_ratio} is outside (-1, 0.5)")
    lame = 2 * poisson_ratio / (1 - 2 * poisson_ratio)
    _, reference = reference_integrals(space.order)
    count = reference.shape[0]
    gradients, volumes = space.gradients_and_volumes()
    g, v = gradients[elements], volumes[elements]
    outer = np.einsum("t,tka,tlb->tklab", v, g, g).reshape(len(v), 16, 9)
    cross = np.matmul(reference.reshape(count * count, 16), outer)  # int d_a N_i d_b N_j
    cross = cross.reshape(len(v), count, count, 3, 3)
    stiffness = lame * cross + np.swapaxes(cross, -1, -2)
    trace = np.trace(cross, axis1=-2, axis2=-1)
    for axis in range(3):
        stiffness[..., axis, axis] += trace
    return stiffness


def assemble(space: LagrangeSpace, poisson_ratio: float) -> tuple[sparse.csc_matrix, sparse.csc_matrix]:
    """Stiffness and mass matrices, each (3 node_count, 3 node_count) float64 CSC, unknown 3 node + axis.

    The spatial unit of `space.vertices` is L. The mass matrix is consistent, so the mass of the body is
    its volume.
    """
    mass_reference, _ = reference_integrals(space.order)
    count = mass_reference.shape[0]
    row = np.repeat(space.nodes, count, axis=1).ravel()
    column = np.tile(space.nodes, (1, count)).ravel()
    key, position = np.unique(row * space.node_count + column, return_inverse=True)
    indices = key % space.node_count
    indptr = np.searchsorted(key, np.arange(space.node_count + 1) * space.node_count)

    blocks = np.zeros((len(key), 9))
    chunk = max(1, 2_000_000 // (count * count))
    for start in range(0, len(space.tetrahedra), chunk):
        elements = slice(start, start + chunk)
        where = position[start * count**2 : (start + chunk) * count**2]
        local = element_stiffness(space, poisson_ratio, elements).reshape(-1, 9)
        touched, target = np.unique(where, return_inverse=True)
        gather = sparse.csr_matrix(
            (np.ones(len(where)), (target, np.arange(len(where)))), shape=(len(touched), len(where))
        )
        blocks[touched] += np.asarray(gather @ local)
    _, volumes = space.gradients_and_volumes()
    mass = np.bincount(position, (volumes[:, None] * mass_reference.ravel()).ravel(), minlength=len(key))

    shape = (3 * space.node_count, 3 * space.node_count)
    stiffness_matrix = sparse.bsr_matrix((blocks.reshape(-1, 3, 3), indices, indptr), shape=shape).tocsc()
    nodal_mass = sparse.csr_matrix((mass, indices, indptr), shape=(space.node_count, space.node_count))
    mass_matrix = sparse.kron(nodal_mass, sparse.identity(3), format="csc")
    return (stiffness_matrix + stiffness_matrix.T) / 2, mass_matrix
