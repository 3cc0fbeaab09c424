"""Sheets: open patches of a surface that bound nothing, given a thickness on both sides."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from objectfolder.surface.surface import Surface, connected_pieces, corner_angles, edge_table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
LONGEST_OFFSET = 2.0  # a corner of a cube moves by the root of 3
OPENING = 0.05
"""Area of the flat lids of a patch's openings over its own, from which on it is a sheet."""


def patches_of(faces: Integers) -> Integers:
    """Patch (f,) of each face: patches hang together through edges of two faces that are wound alike."""
    table = edge_table(faces)
    first, second = table.manifold_pairs()
    alike = table.forward[first] != table.forward[second]
    pairs = first[alike] // 3, second[alike] // 3
    shape = (len(faces), len(faces))
    graph = coo_array((np.ones(len(pairs[0])), pairs), shape=shape)
    return connected_components(graph, directed=False)[1].astype(np.int64)


def opening_shares(surface: Surface, patch: Integers) -> Floats:
    """Area of the openings of each patch (p,) over its own; 0 for a closed one.

    An opening is as large as the vector area of its rim, half of the sum of x cross dx, which for a flat one
    is its area. Openings are taken one by one: the two ends of a tube do not cancel.

    Parameters
    ----------
    patch : (f,) number of each face, from 0 on

    Examples
    --------
    >>> from trimesh.creation import box
    >>> cube = box((1, 1, 1))
    >>> open_cube = Surface(cube.vertices, cube.faces[cube.face_normals[:, 2] < 0.5])
    >>> opening_shares(open_cube, patches_of(open_cube.faces)).round(3).tolist()
    [0.2]
    """
    apart = _apart(surface, patch)
    rim = _rim(apart.faces)
    area = np.bincount(patch, surface.face_areas)
    if len(rim) == 0:
        return np.zeros(len(area))
    # An edge as a triangle without area: pieces of these are the rims.
    _, loop = connected_pieces(np.column_stack([rim, rim[:, 1]]))
    start, end = apart.vertices[rim].swapaxes(0, 1)
    vectors = np.zeros((int(loop.max()) + 1, 3))
    np.add.at(vectors, loop, np.cross(start - surface.bounds.mean(axis=0), end - start) / 2)
    owner = np.zeros(len(apart.vertices), dtype=np.int64)
    owner[apart.faces] = patch[:, None]
    of_loop = np.zeros(len(vectors), dtype=np.int64)
    of_loop[loop] = owner[rim[:, 0]]
    sizes = np.bincount(of_loop, np.linalg.norm(vectors, axis=1), len(area))
    return np.asarray(sizes / np.maximum(area, 1e-300))


def thick_sheets(surface: Surface, sheet: NDArray[np.bool_], patch: Integers, wall_m: float) -> Surface:
    """A surface whose sheets have two sides, `wall_m` apart about where they were, and rims between these.

    Parameters
    ----------
    sheet
        (p,) bool, of each patch: what is made thick. Others stay as they are.
    patch
        (f,) number of each face.
    wall_m
        Metres.
    """
    thick = sheet[patch]
    apart = _apart(Surface(surface.vertices, surface.faces[thick]), patch[thick])
    offset = wall_m / 2 * unit_offsets(apart)
    count, rim = len(apart.vertices), _rim(apart.faces)
    start, end = rim.T
    sides = np.concatenate(
        [
            np.column_stack([end, start, start + count]),
            np.column_stack([end, start + count, end + count]),
        ]
    )
    both = np.concatenate([apart.faces, apart.faces[:, ::-1] + count, sides])
    rest = surface.faces[~thick]
    return Surface(
        np.concatenate([apart.vertices + offset, apart.vertices - offset, surface.vertices]),
        np.concatenate([both, rest + 2 * count]),
    )


def unit_offsets(surface: Surface) -> Floats:
    """How each vertex (v, 3) moves when all faces at it move outwards by one: a normal, longer at creases.

    Least squares of the faces' distances, weighted by their angles; directions that the faces hardly differ
    in are left out, so that a rough surface is moved along its mean normal.
    """
    normals, angles = surface.face_normals, corner_angles(surface.vertices, surface.faces)
    matrix = np.zeros((len(surface.vertices), 3, 3))
    vector = np.zeros((len(surface.vertices), 3))
    for corner, angle in zip(surface.faces.T, angles.T, strict=True):
        np.add.at(matrix, corner, np.einsum("f,fi,fj->fij", angle, normals, normals))
        np.add.at(vector, corner, angle[:, None] * normals)
    offset = np.einsum("vij,vj->vi", np.linalg.pinv(matrix, rcond=0.1, hermitian=True), vector)
    length = np.linalg.norm(offset, axis=1, keepdims=True)
    return np.asarray(offset * np.minimum(1.0, LONGEST_OFFSET / np.maximum(length, 1e-300)))


def _apart(surface: Surface, patch: Integers) -> Surface:
    """The surface with vertices of their own for each patch (f,)."""
    count = len(surface.vertices)
    used, packed = np.unique(patch[:, None] * count + surface.faces, return_inverse=True)
    return Surface(surface.vertices[used % count], packed.reshape(-1, 3))


def _rim(faces: Integers) -> Integers:
    """Directed edges (e, 2) that no other face runs along the other way."""
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    count = int(faces.max(initial=0)) + 1
    forward, backward = edges @ [count, 1], edges @ [1, count]
    return edges[~np.isin(forward, backward)]
