"""Convex hulls that stand for a solid where bodies touch, and how an Object File stores them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import FormatError
from objectfolder.products.stored_values import number
from objectfolder.products.tensor_file import REMEDY
from objectfolder.surface.codec import LARGEST_COORDINATE_M
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
# What a file may hold; the factory makes 16 hulls of 32 corners.
MOST_HULLS, MOST_CORNERS = 1024, 1 << 16
MEASURES = {"union_iou": 1.0, "outward_m": LARGEST_COORDINATE_M, "inward_m": LARGEST_COORDINATE_M}


@dataclass(frozen=True)
class ConvexParts:
    """Convex hulls that stand for a solid where bodies touch.

    Parameters
    ----------
    hulls
        Vertices (n, 3) in metres, object frame, and outward faces (f, 3) of each.
    union_iou
        Volume in both the solid and the union of the hulls, over the volume in either.
    outward_m, inward_m
        Largest distance of a hull's point outside the solid from the surface, and of a point of the surface
        outside all hulls from these, metres.
    """

    hulls: tuple[Surface, ...]
    union_iou: float
    outward_m: float
    inward_m: float

    def tensors(self) -> dict[str, np.ndarray]:
        """Return the corners of all hulls, ``collision.corners`` (n, 3) metres, and how many each has.

        A hull is that of its corners: faces are not stored.
        """
        return {
            "collision.corners": np.concatenate([hull.vertices for hull in self.hulls]),
            "collision.counts": np.array([len(hull.vertices) for hull in self.hulls], dtype=np.int64),
        }

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, np.ndarray], measures: Mapping[str, Any]) -> "ConvexParts":
        """Return the parts whose `tensors` and `to_dict` were stored.

        Raises
        ------
        FormatError
            As `check_parts`, or corners that enclose nothing.
        """
        check_parts(tensors, measures)
        counts = tensors["collision.counts"]
        corners = tensors["collision.corners"].astype(np.float64)
        hulls = [convex_hull(part) for part in np.split(corners, np.cumsum(counts)[:-1])]
        if any(hull is None for hull in hulls):
            raise FormatError("collision", "a hull encloses nothing", REMEDY)
        parts = tuple(hull for hull in hulls if hull is not None)
        return cls(parts, *(float(measures[name]) for name in MEASURES))

    def to_dict(self) -> dict[str, Any]:
        """Return counts and measures as JSON."""
        return {
            "parts": len(self.hulls),
            "vertices": sum(len(hull.vertices) for hull in self.hulls),
            "union_iou": self.union_iou,
            "outward_m": self.outward_m,
            "inward_m": self.inward_m,
        }


def check_parts(tensors: Mapping[str, np.ndarray], measures: Mapping[str, Any]) -> None:
    """Check what `ConvexParts.tensors` and `to_dict` gave, without building a hull.

    Raises
    ------
    FormatError
        Counts that are not those of the corners, more than there may be, measures that are none.
    """
    corners, counts = tensors["collision.corners"], tensors["collision.counts"]
    for name, limit in MEASURES.items():
        number(f"collision.{name}", measures[name], 0.0, limit)
    valid = counts.ndim == 1 and counts.dtype.kind in "iu" and 0 < len(counts) <= MOST_HULLS
    valid = bool(valid and (counts >= 4).all() and (counts <= MOST_CORNERS).all())
    fit = valid and corners.shape == (counts.sum(dtype=np.int64), 3) and len(corners) <= MOST_CORNERS
    if not fit or not np.abs(corners).max() <= LARGEST_COORDINATE_M:
        raise FormatError("collision", "its hulls do not fit together", REMEDY)


def convex_hull(vertices: Floats) -> Surface | None:
    """Return the convex hull of (n, 3) points with outward faces; None where they lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError  # which opening a file does not need

    try:
        hull = ConvexHull(vertices)
    except QhullError:
        return None
    corners = vertices[hull.simplices]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", crossed, hull.equations[:, :3]) < 0
    faces = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    used, renumbered = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], renumbered.reshape(faces.shape))
