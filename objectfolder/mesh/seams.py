"""Seams: rims of one surface that lie on one another but for rounding, and share no vertices."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from objectfolder.surface.surface import edge_table

WIDEST = 1e-4
"""Gap over the longest side that is a seam; scans are noisier."""


def without_seams(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Vertex (F, 3) of each corner, with vertices of rims that lie within `WIDEST` of one another made one.

    Parameters
    ----------
    vertices, faces
        (V, 3) and (F, 3), equal positions welded.

    Returns
    -------
    (F, 3) faces, those given where that would not close the surface: what has openings of its own stays as
    it is, and so does what would lose a face.
    """
    table = edge_table(faces)
    rim = np.unique(table.vertices[table.face_count == 1])
    if len(rim) == 0:
        return faces
    size = float(np.ptp(vertices[faces.reshape(-1)], axis=0).max())
    pairs = KDTree(vertices[rim]).query_pairs(WIDEST * size, output_type="ndarray")
    if len(pairs) == 0:
        return faces
    graph = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(len(rim),) * 2)
    _, label = connected_components(graph, directed=False)
    first = np.unique(label, return_index=True)[1]
    joined = np.arange(len(vertices))
    joined[rim] = rim[first[label]]
    merged = joined[faces]
    collapsed = (merged == np.roll(merged, 1, axis=1)).any()
    return faces if collapsed or (edge_table(merged).face_count == 1).any() else merged
