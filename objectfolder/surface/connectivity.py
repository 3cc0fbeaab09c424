"""How triangles hang together: edges, pieces, and whether they bound a solid."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class EdgeTable:
    """Undirected edges of F triangles.

    Parameters
    ----------
    vertices
        (E, 2) int64, the lower vertex first.
    of_corner
        (3 F,) int64, the edge that starts at each corner (corners in face order).
    forward
        (3 F,) bool, whether the face runs along it from the lower to the higher vertex.
    face_count
        (E,) int64 faces at each edge.
    """

    vertices: np.ndarray
    of_corner: np.ndarray
    forward: np.ndarray
    face_count: np.ndarray

    @property
    def imbalance(self) -> np.ndarray:
        """(E,) forward runs less backward runs; zero everywhere on a closed, consistently wound surface."""
        return np.bincount(
            self.of_corner, weights=np.where(self.forward, 1.0, -1.0), minlength=len(self.vertices)
        ).astype(np.int64)

    def manifold_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (n,), (n,) that share an edge of exactly two faces."""
        order = np.argsort(self.of_corner, kind="stable")
        starts = np.concatenate([[0], np.cumsum(self.face_count)[:-1]])[self.face_count == 2]
        return order[starts], order[starts + 1]


@dataclass(frozen=True)
class Topology:
    """Counts on a welded surface.

    `watertight`: every edge has exactly two faces. `components`: pieces connected through shared vertices.
    `boundary_edges` have one face, `non_manifold_edges` three or more, `zero_area_faces` less than 1e-14 of
    the squared longest side. `consistent`: neighbouring faces are wound alike.
    """

    watertight: bool
    consistent: bool
    components: int
    boundary_edges: int
    non_manifold_edges: int
    zero_area_faces: int


def edge_table(faces: np.ndarray) -> EdgeTable:
    """Edges of (F, 3) faces."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    forward = start < end
    pairs = np.stack([np.minimum(start, end), np.maximum(start, end)], axis=1)
    keys = pairs[:, 0] * (int(faces.max()) + 1) + pairs[:, 1]
    _, first, of_corner, counts = np.unique(keys, return_index=True, return_inverse=True, return_counts=True)
    return EdgeTable(pairs[first], of_corner.reshape(-1), forward, counts)


def connected_pieces(faces: np.ndarray) -> tuple[int, np.ndarray]:
    """Number of pieces connected through shared vertices, and the piece (F,) of each face."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    size = int(faces.max()) + 1
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    graph = coo_array((np.ones(len(start), dtype=bool), (start, end)), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    pieces, of_face = np.unique(label[faces[:, 0]], return_inverse=True)
    return len(pieces), of_face


def topology_of(vertices: np.ndarray, faces: np.ndarray, edges: EdgeTable, areas: np.ndarray) -> Topology:
    """Count what keeps a welded surface (V, 3), (F, 3) with areas (F,) from bounding a solid."""
    smallest = 1e-14 * float(np.ptp(vertices, axis=0).max()) ** 2
    return Topology(
        watertight=bool((edges.face_count == 2).all()),
        consistent=bool((edges.imbalance[edges.face_count == 2] == 0).all()),
        components=connected_pieces(faces)[0],
        boundary_edges=int(np.count_nonzero(edges.face_count == 1)),
        non_manifold_edges=int(np.count_nonzero(edges.face_count > 2)),
        zero_area_faces=int(np.count_nonzero(areas <= smallest)),
    )
