"""Triangles with texture coordinates, put together from grids of quads."""

from dataclasses import dataclass

import numpy as np

from objectfolder.surface.textured_mesh import TexturedMesh


@dataclass(frozen=True)
class Shape:
    """Part of a surface: (V, 3) metres, (F, 3), and (F, 3, 2) texture coordinates of the corners."""

    vertices: np.ndarray
    faces: np.ndarray
    texture_coordinates: np.ndarray

    def textured(self, texture: np.ndarray) -> TexturedMesh:
        """Return the shape with one (h, w, 4) uint8 texture, without collapsed faces and unused vertices."""
        a, b, c = self.faces.T
        whole = (a != b) & (b != c) & (c != a)
        used, faces = np.unique(self.faces[whole], return_inverse=True)
        faces = faces.reshape(-1, 3)
        return TexturedMesh(
            self.vertices[used],
            faces,
            self.texture_coordinates[whole],
            (texture,),
            np.zeros(len(faces), dtype=np.int32),
        )


def quads(indices: np.ndarray, coordinates: np.ndarray, cells: np.ndarray | None = None) -> Shape:
    """Triangles of a grid of vertex indices; the outside is where rows x columns turns counter-clockwise.

    Parameters
    ----------
    indices
        (rows, columns) vertex indices.
    coordinates
        (rows, columns, 2) texture coordinates.
    cells
        (rows - 1, columns - 1) bool, the quads to keep; all by default.

    Returns
    -------
    Shape
        With no vertices of its own.
    """
    chosen = np.ones((indices.shape[0] - 1, indices.shape[1] - 1), dtype=bool) if cells is None else cells
    row, column = np.nonzero(chosen)
    corners = [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column)]
    order = np.array([[0, 1, 2], [0, 2, 3]])
    corner_indices = np.stack([indices[corner] for corner in corners], axis=1)
    corner_coordinates = np.stack([coordinates[corner] for corner in corners], axis=1)
    return Shape(
        np.zeros((0, 3)),
        corner_indices[:, order].reshape(-1, 3),
        corner_coordinates[:, order].reshape(-1, 3, 2),
    )


def join(vertices: np.ndarray, parts: list[Shape]) -> Shape:
    """Return the faces of several parts over common vertices."""
    return Shape(
        vertices,
        np.concatenate([part.faces for part in parts]),
        np.concatenate([part.texture_coordinates for part in parts]),
    )
