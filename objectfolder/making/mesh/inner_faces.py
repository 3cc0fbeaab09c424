"""Faces with solid on both sides: partitions of a body that are part of its file, and of no outside of it.

Every face has two sides. At an edge the faces around it part the space into wedges, and the two sides that
look into one wedge belong to one cell (as in the cell complexes of Zhou, Grinspun, Zorin and Jacobson, "Mesh
Arrangements for Solid Geometry", 2016, without their intersections). What is solid is every cell but the
outside, and but hollows that the winding of all faces around them makes.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from objectfolder.surface.connectivity import EdgeTable, connected_pieces, edge_table
from objectfolder.surface.openings import patches_of
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import WindingNumber, is_closed

FRONT, BACK = 0, 1
_PROBES = 64
"""Faces of an open patch at which it is tested for lying in a solid."""


def inner_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return which of (F, 3) welded faces of (V, 3) vertices have solid on both sides, (F,) bool.

    Walls that share their edges with the outside are found by cells, sheets that share none by the winding
    number of the closed rest. A surface whose edges have two faces each has none.
    """
    table = edge_table(faces)
    inner = np.zeros(len(faces), dtype=bool)
    if (table.face_count == 2).all():
        return inner
    pieces, piece = connected_pieces(faces)
    crowded = np.zeros(pieces, dtype=bool)
    of_face = table.face_count[table.of_corner].reshape(-1, 3).max(axis=1)
    crowded[piece[of_face > 2]] = True
    chosen = np.flatnonzero(crowded[piece])
    if len(chosen):
        inner[chosen] = _between_solid_cells(vertices, faces[chosen])
    rest = np.flatnonzero(~inner)
    inner[rest] = _sheets_within(vertices, faces[rest])
    return inner


def _between_solid_cells(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces (F,) have a solid cell on both sides; faces that share edges have one outside together."""
    cell = _cells(vertices, faces)
    count = int(cell.max()) + 1
    centre = vertices[faces].mean(axis=(0, 1))
    triangles = vertices[faces] - centre
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(cross, axis=1)
    volume = np.einsum("fi,fi->f", triangles[:, 0], cross) / 6
    # A cell sees a face from behind where the normal points out of it.
    enclosed = np.bincount(cell[:, BACK], volume, count) - np.bincount(cell[:, FRONT], volume, count)
    fronts = np.bincount(cell[:, FRONT], area, count)
    backs = np.bincount(cell[:, BACK], area, count)
    beside = coo_array((np.ones(len(cell), dtype=bool), (cell[:, 0], cell[:, 1])), shape=(count, count))
    complexes, of_cell = connected_components(beside, directed=False)
    empty = np.zeros(count, dtype=bool)
    for number in range(complexes):
        cells = np.flatnonzero(of_cell == number)
        outside = cells[np.argmin(enclosed[cells])]
        empty[outside] = True
        inner_cells = cells[cells != outside]
        # Wound as the outside is, all around: the file says that it is hollow.
        inward = backs if fronts[outside] >= backs[outside] else fronts
        empty[inner_cells[(inward[inner_cells] == 0) & (enclosed[inner_cells] != 0)]] = True
    return ~empty[cell].any(axis=1)


def _cells(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Cell (F, 2) that the front and the back of each face look into."""
    table = edge_table(faces)
    edge, forward = table.of_corner, table.forward
    face = np.repeat(np.arange(len(faces)), 3)
    opposite = vertices[np.roll(faces, -2, axis=1).reshape(-1)]
    angle = _angles_around(vertices, table, opposite)
    order = np.lexsort((angle, edge))
    start = np.concatenate([[0], np.cumsum(table.face_count)])
    following = np.arange(1, len(order) + 1)
    following[start[1:] - 1] = start[:-1]
    step, successor = order, order[following]
    # The front of a face that runs along its edge looks towards growing angles.
    side = 2 * face[step] + np.where(forward[step], FRONT, BACK)
    mate = 2 * face[successor] + np.where(forward[successor], BACK, FRONT)
    graph = coo_array((np.ones(len(side), dtype=bool), (side, mate)), shape=(2 * len(faces), 2 * len(faces)))
    return connected_components(graph, directed=False)[1].reshape(-1, 2)


def _angles_around(vertices: np.ndarray, table: EdgeTable, opposite: np.ndarray) -> np.ndarray:
    """Angle (3 F,) at which each corner's face leaves its edge, counter-clockwise about the edge's axis."""
    low, high = vertices[table.vertices[table.of_corner]].swapaxes(0, 1)
    axis = high - low
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-300)
    least = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    across = np.cross(axis, least)
    upright = np.cross(axis, across)
    away = opposite - low
    return np.arctan2(np.einsum("ni,ni->n", away, upright), np.einsum("ni,ni->n", away, across))


def _sheets_within(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces (F,) belong to open patches that lie within the solid of the closed ones."""
    surface = Surface(vertices, faces)
    if is_closed(surface):
        return np.zeros(len(faces), dtype=bool)
    patch = patches_of(surface.edges)
    count = int(patch.max()) + 1
    corners = surface.edges.face_count[surface.edges.of_corner].reshape(-1, 3)
    is_open = np.bincount(patch, (corners != 2).any(axis=1), count) > 0
    closed = ~is_open[patch]
    if not closed.any() or not is_open.any():
        return np.zeros(len(faces), dtype=bool)
    rest = Surface(vertices, faces[closed])
    if not is_closed(rest):
        return np.zeros(len(faces), dtype=bool)
    winding = WindingNumber(rest)
    within = np.zeros(count, dtype=bool)
    for number in np.flatnonzero(is_open):
        members = np.flatnonzero(patch == number)
        probes = members[np.linspace(0, len(members) - 1, min(_PROBES, len(members))).astype(np.int64)]
        within[number] = bool((np.abs(winding(vertices[faces[probes]].mean(axis=1))) > 0.5).all())
    return within[patch]
