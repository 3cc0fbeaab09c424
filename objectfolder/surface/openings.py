"""Patches of a surface, and how large their openings are for what is around them."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from objectfolder.surface.connectivity import EdgeTable, connected_pieces
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
LEAST_OPENING = 0.05
"""Area of the flat lids of a patch's openings over its own, from which on it is a sheet."""
CRACK = 0.003
"""Distance over the longest side up to which two rims along one another are the sides of a crack."""
MATCHED, OTHER_WAY, RIM_NEIGHBOURS, MOST_RIM_STEPS = 0.98, -0.7, 16, 100_000


def patches_of(table: EdgeTable) -> Integers:
    """Patch (f,) of each face: patches hang together through edges of two faces that are wound alike."""
    first, second = table.manifold_pairs()
    alike = table.forward[first] != table.forward[second]
    count = len(table.of_corner) // 3
    pairs = first[alike] // 3, second[alike] // 3
    graph = coo_array((np.ones(len(pairs[0])), pairs), shape=(count, count))
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
    >>> opening_shares(open_cube, patches_of(open_cube.edges)).round(3).tolist()
    [0.2]
    """
    parted = apart(surface, patch)
    rim = rim_of(parted.faces)
    area = np.bincount(patch, surface.face_areas)
    if len(rim) == 0:
        return np.zeros(len(area))
    # An edge as a triangle without area: pieces of these are the rims.
    _, loop = connected_pieces(np.column_stack([rim, rim[:, 1]]))
    start, end = parted.vertices[rim].swapaxes(0, 1)
    vectors = np.zeros((int(loop.max()) + 1, 3))
    np.add.at(vectors, loop, np.cross(start - surface.bounds.mean(axis=0), end - start) / 2)
    owner = np.zeros(len(parted.vertices), dtype=np.int64)
    owner[parted.faces] = patch[:, None]
    of_loop = np.zeros(len(vectors), dtype=np.int64)
    of_loop[loop] = owner[rim[:, 0]]
    sizes = np.bincount(of_loop, np.linalg.norm(vectors, axis=1), len(area))
    return np.asarray(sizes / np.maximum(area, 1e-300))


def has_cracks_only(surface: Surface) -> bool:
    """Whether another rim, or another part of it, runs the other way beside all rims within `CRACK`.

    Such a surface is closed but for cracks, as a lid that was not joined: nothing shows what is within.

    Examples
    --------
    >>> from trimesh.creation import box
    >>> vertices, faces = box((1, 1, 1)).vertices, box((1, 1, 1)).faces
    >>> lid = (vertices[faces][..., 2] > 0).all(axis=1)
    >>> cracked = Surface(np.concatenate([vertices, vertices + [0, 0, 1e-3]]), faces + 8 * lid[:, None])
    >>> has_cracks_only(cracked), has_cracks_only(Surface(vertices, faces[~lid]))
    (True, False)
    """
    patch = patches_of(surface.edges)
    parted = apart(surface, patch)
    rim = rim_of(parted.faces)
    start, end = parted.vertices[rim].swapaxes(0, 1)
    length = np.linalg.norm(end - start, axis=1)
    width = CRACK * float(np.ptp(surface.bounds, axis=0).max())
    count = np.maximum(1, np.ceil(length / width)).astype(np.int64)
    if len(rim) == 0 or count.sum() > MOST_RIM_STEPS:
        return False
    edge = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    points = start[edge] + (end - start)[edge] * ((step + 0.5) / count[edge])[:, None]
    direction = ((end - start) / np.maximum(length, 1e-300)[:, None])[edge]
    # Steps are no longer than the width: of a rim beside, one lies within 1.5 of it.
    near = KDTree(points).query(points, k=RIM_NEIGHBOURS, distance_upper_bound=1.5 * width)[1]
    exists = near < len(points)
    near = np.where(exists, near, 0)
    opposite = np.einsum("pnx,px->pn", direction[near], direction) < OTHER_WAY
    across = np.linalg.norm(np.cross(points[near] - points[:, None], direction[:, None]), axis=2)
    matched = (exists & opposite & (across <= width)).any(axis=1)
    weight = (length / count)[edge]
    return bool((weight * matched).sum() >= MATCHED * weight.sum())


def apart(surface: Surface, patch: Integers) -> Surface:
    """The surface with vertices of their own for each patch (f,)."""
    count = len(surface.vertices)
    used, packed = np.unique(patch[:, None] * count + surface.faces, return_inverse=True)
    return Surface(surface.vertices[used % count], packed.reshape(-1, 3))


def rim_of(faces: Integers) -> Integers:
    """Directed edges (e, 2) that no other face runs along the other way."""
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    count = int(faces.max(initial=0)) + 1
    forward, backward = edges @ [count, 1], edges @ [1, count]
    return edges[~np.isin(forward, backward)]
