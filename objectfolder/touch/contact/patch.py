"""The faces of a surface near a point, a box or the gel, found in a tree of boxes over them."""

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.surface.bounding_boxes import BoundingBoxTree
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact import tree_queries
from objectfolder.touch.contact.tree_queries import Tree


class FacePatches:
    """A surface prepared for presses: which faces are near, and with which corners and normals.

    Everything is in double precision, and no face that a query meets is missing.

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
        usable = surface.face_areas > 0
        if not usable.any():
            raise QueryError("surface", "no face has an area", "Touch needs a surface.")
        if not usable.all():
            normals = None if surface.normals is None else surface.normals[usable]
            surface = Surface(surface.vertices, surface.faces[usable], normals=normals)
        self.surface = surface
        self.triangles = surface.vertices[surface.faces]
        self.face_normals = surface.face_normals
        self.corner_normals = surface.corner_normals
        boxes = BoundingBoxTree(self.triangles)
        self._tree = Tree(boxes.boxes, boxes.order, self.triangles)
        # Faces for which a query has room at first: what the largest before has found.
        self._near, self._in_balls = 512, 64
        self.diagonal_m = float(np.linalg.norm(np.ptp(self.triangles.reshape(-1, 3), axis=0)))

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Face (n,) nearest to each point (n, 3), and barycentric coordinates (n, 3) of its nearest point.

        Of faces equally near the one of lowest index.
        """
        face, barycentric = np.empty(len(points), dtype=np.int64), np.zeros((len(points), 3))
        stack = np.empty(tree_queries.TREE_STACK, dtype=np.int64)
        tree_queries.closest(self._tree, points, stack, face, barycentric)
        return face, barycentric

    def in_balls(self, points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Faces whose boxes meet balls round points (n, 3): those of i are faces[starts[i]:starts[i + 1]]."""
        starts = np.empty(len(points) + 1, dtype=np.int64)
        while True:
            faces = np.empty(self._in_balls * len(points), dtype=np.int64)
            count = tree_queries.in_balls(self._tree, points, radius, starts, faces)
            if count <= len(faces):
                return starts, faces[:count]
            self._in_balls = -(-count // len(points))

    def near_gel(
        self, pose: np.ndarray, gel: np.ndarray, least: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Faces (m,) that may reach deeper into the gel than `least` metres, in the order of the tree.

        Also their corners (m, 3, 3) in the frame of `pose` (4, 4), the sensor's, and bounds (m,) of their
        indentation. `gel` is as of `gel.gel_constants`.
        """
        while True:
            room = self._near + 1
            faces, corners, bounds = np.empty(room, dtype=np.int64), np.empty((room, 3, 3)), np.empty(room)
            count = tree_queries.near_gel(self._tree, pose, gel, least, np.empty(6), faces, corners, bounds)
            if count < room:
                return faces[:count], corners[:count], bounds[:count]
            self._near = count

    def enters_box(self, pose: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
        """Whether any face enters the open box between corners (3,) in the frame of `pose` (4, 4)."""
        working = (high - low) / 2, np.empty((3, 3)), np.empty(6)
        return bool(tree_queries.enters_box(self._tree, pose, low, high, *working))


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
    return Surface(placed[first], place[surface.faces], normals=surface.normals)
