"""A surface as triangles of nearly one size, for boundary elements."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
COLLAPSED_SHARE = 0.4  # of the triangles, left by edge collapse; halving of long edges adds the rest
SAME_PLACE = 1e-7  # of the longest side, below which corners of faces are one
LONGEST = 1.6  # edges, of an edge that stays


def remeshed(surface: Surface, edge_m: float) -> Surface:
    """Closed triangles with edges of about `edge_m` metres on a closed surface; thin walls stay apart.

    Faces may have their corners each for itself. Quadric edge collapse (VTK) keeps rims and walls, and leaves
    long triangles on what is flat, whose edges are halved.
    """
    import pyvista  # which a query of an Object File does without

    surface = joined(surface)
    face_count = COLLAPSED_SHARE * surface.area / (np.sqrt(3) / 4 * edge_m**2)
    if face_count < len(surface.faces):
        mesh = pyvista.PolyData.from_regular_faces(surface.vertices, surface.faces)
        less = mesh.decimate(1 - face_count / len(surface.faces), volume_preservation=True)
        surface = Surface(np.asarray(less.points, dtype=np.float64), np.asarray(less.regular_faces, np.int64))
    return halved(surface, LONGEST * edge_m)


def joined(surface: Surface) -> Surface:
    """Return the surface with one vertex in each place, and without faces that have two corners in one."""
    vertices = surface.vertices
    pairs = cKDTree(vertices).query_pairs(
        SAME_PLACE * np.ptp(surface.bounds, axis=0).max(), output_type="ndarray"
    )
    links = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(vertices),) * 2)
    count, place = connected_components(links, directed=False)
    positions = np.zeros((count, 3))
    positions[place] = vertices
    faces = place[surface.faces].astype(np.int64)
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return Surface(positions, faces[whole])


def halved(surface: Surface, longest_m: float) -> Surface:
    """Return the surface with every edge longer than `longest_m` cut in its middle, faces staying joined.

    An edge is cut when it is the longest of all faces at it (Rivara, Int. J. Numer. Meth. Eng. 20, 1984).
    """
    vertices, faces = surface.vertices, surface.faces
    while True:
        ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
        edges, number = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
        number = number.reshape(-1, 3)
        # No two edges are equally long: ties are broken by number, for one face to have one longest edge.
        length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
        rank = np.empty(len(edges), dtype=np.int64)
        rank[np.lexsort((np.arange(len(edges)), length))] = np.arange(len(edges))
        first = rank[number].argmax(axis=1)
        rows = np.arange(len(faces))
        shared, leading = (
            np.bincount(number.reshape(-1)),
            np.bincount(number[rows, first], minlength=len(edges)),
        )
        cut = (length > longest_m) & (shared == leading)
        if not cut.any():
            return Surface(vertices, faces)
        middle = np.full(len(edges), -1)
        middle[cut] = len(vertices) + np.arange(np.count_nonzero(cut))
        vertices = np.concatenate([vertices, vertices[edges[cut]].mean(axis=1)])
        split = np.flatnonzero(cut[number[rows, first]])
        a, b, c = (faces[split, (first[split] + turn) % 3] for turn in range(3))
        m = middle[number[split, first[split]]]
        rest = faces[~cut[number[rows, first]]]
        faces = np.concatenate([rest, np.stack([a, m, c], axis=1), np.stack([m, b, c], axis=1)])
