"""Which faces are where: closest points, balls and oriented boxes, in a tree of boxes over the faces.

The boxes are those of `objectfolder.surface.bounding_boxes`, flattened: the children of node i are
2 i + 1 and 2 i + 2. Everything is in double precision, and no face that a query meets is missing.
"""

from dataclasses import dataclass

import numpy as np

from objectfolder.surface.bounding_boxes import BoundingBoxTree
from objectfolder.touch.compiled.box_queries import enters_box, in_box, near_gel
from objectfolder.touch.compiled.point_queries import closest, in_balls


@dataclass(frozen=True)
class FaceTree:
    """Boxes over faces.

    Parameters
    ----------
    boxes
        (nodes, 6) float64 lower and upper corners, metres; the last ``leaves`` are leaves.
    order
        (leaves, 4) int64 faces of each leaf, -1: none.
    triangles
        (F, 3, 3) float64 corners.
    """

    boxes: np.ndarray
    order: np.ndarray
    triangles: np.ndarray

    @classmethod
    def of_triangles(cls, triangles: np.ndarray) -> "FaceTree":
        """Build over (F, 3, 3) corners, metres."""
        tree = BoundingBoxTree(triangles)
        boxes = np.concatenate([np.concatenate(tree.low), np.concatenate(tree.high)], axis=1)
        return cls(boxes, np.ascontiguousarray(tree.order), np.ascontiguousarray(triangles))

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Face (n,) nearest to each point (n, 3), and barycentric coordinates (n, 3) of its nearest point.

        Of faces equally near the one of lowest index.
        """
        return closest(self.boxes, self.order, self.triangles, points)

    def in_balls(self, points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Faces whose boxes meet balls round points (n, 3): those of i are faces[starts[i]:starts[i + 1]]."""
        return in_balls(self.boxes, self.order, self.triangles, points, radius)

    def in_box(self, pose: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Faces (m,) that may meet a box, ascending, and their corners (m, 3, 3) in the frame of `pose`.

        The box is given by its corners (3,) in the frame of `pose` (4, 4).
        """
        return in_box(self.boxes, self.order, self.triangles, pose, low, high)

    def near_gel(
        self, pose: np.ndarray, gel: np.ndarray, least: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Faces (m,) that may reach deeper into the gel than `least` metres, in the order of the tree.

        Also their corners (m, 3, 3) in the frame of `pose` (4, 4), the sensor's, and bounds (m,) of their
        indentation. `gel` is as of `contact.gel_constants`.
        """
        return near_gel(self.boxes, self.order, self.triangles, pose, gel, least)

    def enters_box(self, pose: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
        """Whether any face enters the open box."""
        return bool(enters_box(self.boxes, self.order, self.triangles, pose, low, high))
