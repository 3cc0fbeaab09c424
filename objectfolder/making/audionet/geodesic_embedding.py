"""Geodesic embedding by landmark MDS: how much longer ways within the body are than through the air.

The tines of a fork and the ribs of a spatula are near to one another in space and far apart in the body:
they move independently. The detour between two points is what their distance within the body has more than
the straight line, d_body^2 - |x - y|^2; classical multidimensional scaling of its matrix over landmarks
(de Silva and Tenenbaum, "Sparse multidimensional scaling using landmark points", 2004) gives coordinates e
with |e(x) - e(y)|^2 near the detour, zero on a convex body.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra

from objectfolder.audio.audionet.surface_kernel import vertex_normals
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LANDMARKS = 100
LONGEST_EDGE = 1 / 24  # of the object's size
GEODESIC_VERTICES = 20_000
STRAIGHTENING = 0.85  # a straight way over its path along edges


def geodesic_embedding(surface: Surface, dimensions: int) -> tuple[Floats, Floats]:
    """Embed the vertices so that distances are detours.

    Parameters
    ----------
    surface
        Metres, outward faces; pieces without connection count as two sizes of the object apart.
    dimensions
        Number of coordinates.

    Returns
    -------
    coordinates
        (vertices, dimensions) metres, the widest first; zero for vertices that no face uses.
    spread
        (dimensions,) metres, root mean square of each coordinate over the landmarks.
    """
    size = float(np.ptp(surface.bounds, axis=0).max())
    fine = Surface(*subdivide(surface.vertices, surface.faces, LONGEST_EDGE * size, GEODESIC_VERTICES))
    used = np.unique(fine.faces)
    marks = used[farthest_points(fine.vertices[used], min(LANDMARKS, len(used)))]
    within = dijkstra(_graph(fine, size), directed=False, indices=marks)
    within = np.minimum(np.where(np.isfinite(within), within, np.inf), 2 * size)
    straight = np.zeros_like(within)
    for axis in range(3):
        straight += np.subtract.outer(fine.vertices[marks, axis], fine.vertices[:, axis]) ** 2
    detour = np.maximum((STRAIGHTENING * within) ** 2 - straight, 0.0)
    between = (detour[:, marks] + detour[:, marks].T) / 2
    centre = np.eye(len(marks)) - 1 / len(marks)
    values, vectors = np.linalg.eigh(-centre @ between @ centre / 2)
    values, vectors = values[::-1][:dimensions], vectors[:, ::-1][:, :dimensions]
    vectors = vectors * np.where(vectors[np.abs(vectors).argmax(axis=0), np.arange(len(values))] < 0, -1, 1)
    positive = values > 1e-9 * size**2
    scaled = np.where(positive, vectors / np.sqrt(np.where(positive, values, 1.0)), 0.0)
    coordinates = -(detour.T - between.mean(axis=0)) @ scaled / 2
    result = np.zeros((len(surface.vertices), dimensions))
    inside = used[used < len(surface.vertices)]
    result[inside, : len(values)] = coordinates[inside]
    spread = np.zeros(dimensions)
    spread[: len(values)] = np.sqrt(np.maximum(values, 0.0) / len(marks))
    return result, spread


def farthest_points(
    features: Floats, count: int, weights: Floats | None = None, start: Floats | None = None
) -> Integers:
    """Farthest-point order: indices (count,) such that any leading part of it is spread out.

    Parameters
    ----------
    features
        (n, dimensions) of the points to choose from.
    count
        How many.
    weights
        (n,) factors of the squared distances: more are chosen where they are large.
    start
        (m, dimensions) features to be far from as well; without them the first point is the first chosen.
    """
    factor = np.ones(len(features)) if weights is None else weights
    distance = np.full(len(features), np.inf)
    for feature in [] if start is None else start:
        distance = np.minimum(distance, np.sum((features - feature) ** 2, axis=1))
    chosen = np.zeros(count, dtype=np.int64)
    for step in range(count):
        if step > 0 or start is not None:
            chosen[step] = (distance * factor).argmax()
        distance = np.minimum(distance, np.sum((features - features[chosen[step]]) ** 2, axis=1))
    return chosen


def subdivide(vertices: Floats, faces: Integers, longest: float, most: int) -> tuple[Floats, Integers]:
    """Halve the edges of faces longer than `longest`, until none is or there are `most` vertices.

    Vertices keep their numbers. A face cut beside one left whole shares the edge's ends with it, and has
    its middle for itself.
    """
    while True:
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        length = np.linalg.norm(vertices[edges[..., 0]] - vertices[edges[..., 1]], axis=2)
        long = length.max(axis=1) > longest
        if not long.any() or len(vertices) >= most:
            return vertices, faces
        pairs, number = np.unique(edges[long].reshape(-1, 2), axis=0, return_inverse=True)
        a, b, c = faces[long].T
        ab, bc, ca = len(vertices) + number.reshape(-1, 3).T
        vertices = np.concatenate([vertices, vertices[pairs].mean(axis=1)])
        quarters = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        faces = np.concatenate([faces[~long], *(np.stack(quarter, axis=1) for quarter in quarters)])


def _graph(surface: Surface, size: float) -> csr_matrix:
    """Lengths of edges, and of the straight ways from each vertex through the body to its other side."""
    faces, vertices = surface.faces, surface.vertices
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    normals = vertex_normals(surface)
    hits = surface.ray_hits(vertices - 1e-5 * size * normals, -normals)
    through = np.flatnonzero(hits.face >= 0)
    nearest = hits.barycentric[through].argmax(axis=1)
    across = np.stack([through, faces[hits.face[through], nearest]], axis=1)
    pairs = np.unique(np.sort(np.concatenate([edges, across]), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    length = np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)
    # An explicit zero would be no edge.
    length = np.maximum(length, 1e-9 * size)
    return coo_matrix((length, (pairs[:, 0], pairs[:, 1])), shape=(len(vertices),) * 2).tocsr()
