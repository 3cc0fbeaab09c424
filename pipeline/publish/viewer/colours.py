"""The colour of a surface, as fine as a static player draws it."""

import numpy as np

from objectfolder.object_file import ObjectFile
from objectfolder.vision.export.base_colour import network_colour

# An export has 24, for it is lit anew elsewhere; these colours differ from it by less than what is left out.
LIGHT_DIRECTIONS = 4


def surface_colours(file: ObjectFile) -> np.ndarray:
    """Return (vertices + edges, 3) uint8 sRGB at the vertices and in the middle of the edges.

    It is the share of light from all directions that leaves along the normal, by the VisionNet, without what
    a clear coat reflects.
    """
    faces = file.surface.faces
    sides = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    code = np.sort(sides, axis=1) @ np.array([faces.max() + 1, 1])
    _, first = np.unique(code, return_index=True)
    edge_face, edge_corner = np.divmod(np.sort(first), 3)
    corners = np.zeros(len(file.surface.vertices), dtype=np.int64)
    corners[faces.ravel()] = np.arange(faces.size)
    vertex_face, vertex_corner = np.divmod(corners, 3)
    middles = (np.eye(3) + np.roll(np.eye(3), 1, axis=1)) / 2
    face = np.concatenate([vertex_face, edge_face])
    barycentric = np.concatenate([np.eye(3)[vertex_corner], middles[edge_corner]])
    metallic = float((file.description["material"] or {}).get("metallic", 0.0))
    colours = network_colour(
        file.vision, file.surface, file.frame, face, barycentric, metallic, LIGHT_DIRECTIONS
    )
    return np.asarray(np.rint(colours[:, :3] * 255), dtype=np.uint8)
