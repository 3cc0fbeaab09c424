"""The faces of a surface near a point, found by bounding spheres."""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface

if TYPE_CHECKING:
    from objectfolder.touch.compiled.face_tree import FaceTree


class FacePatches:
    """A surface prepared for presses: who is near, and with which corners and normals.

    Parameters
    ----------
    surface
        Any triangle surface. Vertices in one place, as along the seams of textures, become one, so that
        normals are smooth there; faces without area are left out.

    Raises
    ------
    QueryError
        A surface without area.
    """

    def __init__(self, surface: Surface) -> None:
        surface = _welded(surface)
        kept = surface.face_areas > 0
        if not kept.any():
            raise QueryError("surface", "no face has an area", "Touch needs a surface.")
        if not kept.all():
            surface = Surface(surface.vertices, surface.faces[kept])
        self.surface = surface
        self.triangles = surface.vertices[surface.faces]
        self.face_normals = surface.face_normals
        self.corner_normals = surface.corner_normals
        low, high = self.triangles.min(axis=1), self.triangles.max(axis=1)
        self._centres = np.ascontiguousarray(((low + high) / 2).T)
        spread = self.triangles - self._centres.T[:, None]
        self._radii = np.sqrt(np.einsum("ijk,ijk->ij", spread, spread).max(axis=1))

    @cached_property
    def tree(self) -> "FaceTree":
        """Boxes over the faces, for the compiled kernels."""
        from objectfolder.touch.compiled.face_tree import FaceTree

        return FaceTree.of_triangles(self.triangles)

    def near(self, centre: np.ndarray, radius: float) -> np.ndarray:
        """Indices of the faces whose bounding sphere meets the ball (centre (3,), radius), metres."""
        x, y, z = self._centres
        squared = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2
        return np.flatnonzero(squared <= (self._radii + radius) ** 2)

    def in_box(self, pose: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Indices of the faces that may meet a box, given by its corners (3,) in the frame of `pose` (4, 4).

        None that meets it is missing; some that pass near may be there.
        """
        half = (high - low) / 2
        centre = pose[:3, :3] @ (low + half) + pose[:3, 3]
        near = self.near(centre, float(np.linalg.norm(half)))
        x, y, z = (self._centres[axis, near] - centre[axis] for axis in range(3))
        reach = self._radii[near]
        meets = np.ones(len(near), dtype=bool)
        for axis in range(3):
            r = pose[:3, axis]
            meets &= np.abs(x * r[0] + y * r[1] + z * r[2]) <= half[axis] + reach
        return np.asarray(near[meets])

    def corners_in(self, pose: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Corners (m, 3, 3) of `faces` (m,) in the frame of `pose`; shared corners get equal bits."""
        triangles = self.triangles[faces]
        x, y, z = (triangles[..., axis] - pose[axis, 3] for axis in range(3))
        return np.stack([x * r[0] + y * r[1] + z * r[2] for r in pose[:3, :3].T], axis=-1)


def _welded(surface: Surface) -> Surface:
    """Return the surface with one vertex a place; itself where that is so."""
    order = np.lexsort(surface.vertices.T)
    placed = surface.vertices[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = (placed[1:] != placed[:-1]).any(axis=1)
    if first.all():
        return surface
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.cumsum(first) - 1
    return Surface(placed[first], place[surface.faces])
