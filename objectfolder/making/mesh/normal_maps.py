"""Normals of a surface bent by maps in tangent space, as renderers bend them."""

from collections.abc import Mapping

import numpy as np

from objectfolder.surface.surface import corner_angles
from objectfolder.surface.texture_lookup import bilinear


class MappedNormals:
    """Shading normals of triangles of which some have a map.

    Tangents are those of MikkTSpace (Mikkelsen 2008, "Simulation of wrinkled surfaces revisited"): along u in
    the tangent plane of each corner, averaged by angle over the corners that share vertex, normal, texture
    coordinates and handedness. Between corners tangent and normal are interpolated and not made orthogonal
    again.

    Parameters
    ----------
    vertices, faces
        (V, 3) and (F, 3).
    corner_normals
        (F, 3, 3) unit normals.
    texture_coordinates, face_texture
        (F, 3, 2) u, v of each corner, v up, and (F,) texture of each face.
    normal_maps
        By texture, as of `mesh.TexturedMesh`.
    """

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        corner_normals: np.ndarray,
        texture_coordinates: np.ndarray,
        face_texture: np.ndarray,
        normal_maps: Mapping[int, np.ndarray],
    ) -> None:
        self._corner_normals = corner_normals
        self._texture_coordinates, self._face_texture = texture_coordinates, face_texture
        self._normal_maps = normal_maps
        if normal_maps:
            self._tangents, self._handedness = corner_tangents(
                vertices, faces, corner_normals, texture_coordinates
            )

    def at(self, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return unit normals (n, 3) at barycentric coordinates (n, 3) of faces (n,), outside; 0 for none."""
        normal = np.einsum("ij,ijk->ik", barycentric, self._corner_normals[face])
        for texture, image in self._normal_maps.items():
            own = np.flatnonzero(self._face_texture[face] == texture)
            faces, weights, upright = face[own], barycentric[own], normal[own]
            coordinates = np.einsum("ij,ijk->ik", weights, self._texture_coordinates[faces])
            x, y, z = (2.0 * bilinear(image, coordinates) - 1.0).T[..., None]
            tangent = np.einsum("ij,ijk->ik", weights, self._tangents[faces])
            across = self._handedness[faces, None] * np.cross(upright, tangent)
            # Without a tangent a map says nothing.
            mapped = tangent.any(axis=1, keepdims=True)
            normal[own] = np.where(mapped, x * tangent + y * across + z * upright, upright)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.asarray(normal / np.maximum(length, 1e-12))


def corner_tangents(
    vertices: np.ndarray, faces: np.ndarray, corner_normals: np.ndarray, texture_coordinates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return unit tangents (F, 3, 3) of corners, 0 where u has no direction, and handedness (F,) 1 or -1.

    The handedness is -1 where the texture is mirrored.
    """
    corners = vertices[faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    du, dv = np.moveaxis(texture_coordinates[:, 1:] - texture_coordinates[:, :1], 2, 0)
    handedness = np.where(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0] < 0, -1.0, 1.0)
    along = handedness[:, None] * (dv[:, 1:] * first - dv[:, :1] * second)
    off = np.einsum("fij,fj->fi", corner_normals, along)[..., None] * corner_normals
    tangents = _unit(along[:, None] - off) * corner_angles(vertices, faces)[..., None]
    keys = np.column_stack(
        [
            faces.ravel(),
            np.repeat(handedness, 3),
            np.round(texture_coordinates.reshape(-1, 2) * 2**20),
            np.round(corner_normals.reshape(-1, 3) * 2**12),
        ]
    )
    shared = np.unique(keys.astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    summed = np.stack(
        [np.bincount(shared, tangents[..., axis].ravel()) for axis in range(3)], axis=1
    )[shared].reshape(tangents.shape)  # fmt: skip
    return _unit(summed), handedness


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 1e-12)
