"""Flat elements that lie on the boundary with two or three faces, taken off.

On a smooth surface such faces are nearly in one plane, and an element between them cannot be curved to follow
it: its Jacobian would vanish along their common edge.
"""

import numpy as np
from numpy.typing import NDArray

from objectfolder.solid.element_shape import heights_and_edges
from objectfolder.solid.solid import LOCAL_FACES

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
IN_ONE_PLANE = float(np.cos(np.radians(30)))  # of the normals of two boundary faces
MOST_ROUNDS = 20


def peel(vertices: Floats, tetrahedra: Integers, tolerance: Floats) -> Integers:
    """Take off elements whose boundary faces are within 30 degrees of one plane, (t', 4).

    Parameters
    ----------
    tolerance
        (v,) an element stays where it is higher than this at one of its vertices. It also stays where its
        removal would change the topology: where the edge it would uncover is on the boundary already.
    """
    for _ in range(MOST_ROUNDS):
        outer, normals, edges = _outside(vertices, tetrahedra)
        count = outer.sum(axis=1)
        least, _ = heights_and_edges(vertices[tetrahedra])
        cosine = np.einsum("tik,tjk->tij", normals, normals)
        pairs = outer[:, :, None] & outer[:, None, :]
        flat = np.where(pairs, cosine, 1.0).min(axis=(1, 2)) > IN_ONE_PLANE
        thin = least <= tolerance[tetrahedra].min(axis=1)
        rows = np.flatnonzero(((count == 2) | (count == 3)) & flat & thin)
        touched = np.zeros(len(vertices), dtype=bool)
        gone = np.zeros(len(tetrahedra), dtype=bool)
        for row in rows[np.argsort(least[rows], kind="stable")].tolist():
            corners = tetrahedra[row]
            if touched[corners].any():
                continue
            first, second = sorted(corners[outer[row]].tolist())[:2]
            if count[row] == 2 and first * len(vertices) + second in edges:
                continue
            touched[corners] = gone[row] = True
        if not gone.any():
            break
        tetrahedra = tetrahedra[~gone]
    return tetrahedra


def flat_on_boundary(vertices: Floats, tetrahedra: Integers) -> int:
    """Number of elements with boundary faces within 30 degrees of one plane."""
    outer, normals, _ = _outside(vertices, tetrahedra)
    cosine = np.einsum("tik,tjk->tij", normals, normals)
    pairs = outer[:, :, None] & outer[:, None, :] & ~np.eye(4, dtype=bool)
    return int(np.count_nonzero((pairs & (cosine > IN_ONE_PLANE)).any(axis=(1, 2))))


def _outside(vertices: Floats, tetrahedra: Integers) -> tuple[NDArray[np.bool_], Floats, set[int]]:
    """Which faces (t, 4) are on the boundary, outward unit normals (t, 4, 3), and edges of the boundary."""
    faces = tetrahedra[:, LOCAL_FACES]
    flat = faces.reshape(-1, 3)
    _, number, shared = np.unique(np.sort(flat, axis=1), axis=0, return_inverse=True, return_counts=True)
    outer = (shared[number.reshape(-1)] == 1).reshape(-1, 4)
    corner = vertices[faces]
    normals = np.cross(corner[:, :, 1] - corner[:, :, 0], corner[:, :, 2] - corner[:, :, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300)
    edges = np.sort(faces[outer][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return outer, normals, set((edges[:, 0] * len(vertices) + edges[:, 1]).tolist())
