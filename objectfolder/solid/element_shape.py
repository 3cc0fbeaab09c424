"""How flat a tetrahedron is, next to the wall it lies in."""

import numpy as np
from numpy.typing import NDArray

from objectfolder.solid.solid import LOCAL_FACES

Floats = NDArray[np.float64]
LOCAL_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def heights_and_edges(corner: Floats) -> tuple[Floats, Floats]:
    """Least height (n,), negative where inverted, and longest edge (n,) of tetrahedra (n, 4, 3)."""
    volume = np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6
    face = corner[:, LOCAL_FACES]
    doubled = np.linalg.norm(np.cross(face[:, :, 1] - face[:, :, 0], face[:, :, 2] - face[:, :, 0]), axis=-1)
    edge = corner[:, LOCAL_EDGES[:, 0]] - corner[:, LOCAL_EDGES[:, 1]]
    longest = np.sqrt(np.einsum("nek,nek->ne", edge, edge).max(axis=1))
    return 6 * volume / np.maximum(doubled.max(axis=1), 1e-300), longest


def shape(corner: Floats, thickness: Floats) -> tuple[Floats, Floats]:
    """Shape (n,) and longest edge (n,) of tetrahedra (n, 4, 3) where the object is `thickness` (n,) thick.

    The shape is the least height over the thickness, or over half the longest edge where that is less: a long
    flat element that reaches through a wall has shape 1, as has a compact one in a block; a sliver has 0. A
    regular tetrahedron in a block has 1.63.
    """
    height, longest = heights_and_edges(corner)
    return height / np.maximum(np.minimum(thickness, longest / 2), 1e-300), longest
