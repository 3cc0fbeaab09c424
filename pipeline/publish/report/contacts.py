"""Where on the object the touches of a page were made, drawn on its surface in plain clay."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from objectfolder.surface.surface import Surface
from pipeline.publish.report.object_products import ObjectProducts
from pipeline.publish.report.pictures import indexed_uri

PIXELS = 150
FIELD_OF_VIEW_DEG = 32.0
FOCAL = PIXELS / 2 / np.tan(np.radians(FIELD_OF_VIEW_DEG / 2))
# In diagonals of the bounding box: of the camera from its centre (the whole object is in the picture from
# every side), and how far out the arrow that shows the sensor's way begins.
DISTANCE, ARROW = 2.1, 0.22
# Between the surface's normal and the directions that are tried: oblique enough to show relief.
OBLIQUE_DEG = 41.0
TRIED = 8
# Of the distance to the camera: what hides a point lies farther before it than this.
NEAR = 0.004
# Grey of each level: nothing beside the object, then from shadow to light.
SHADES = 64
CLAY = np.repeat(np.linspace(70, 225, SHADES)[:, None], 3, axis=1)
LIGHT = np.array([-0.45, 0.55, 0.9]) / np.linalg.norm([0.45, 0.55, 0.9])  # from the upper left
TOUCH_ARRAYS = ("points", "normals", "sensor_to_object", "depth_m", "tilt_deg", "contact_area_m2")


class Contact(NamedTuple):
    """One touch, drawn: positions are pixels of a square picture of `size`.

    Parameters
    ----------
    picture
        The object, as a data URI.
    visible
        Whether the contact point is in sight.
    spot, arrow
        (x, y) of the contact point, and of where the arrow along the outward normal begins.
    gel
        Corners of the gel's plane at its apex, as an SVG polygon's points.
    labels
        What is known of the touch: name, value, unit.
    """

    picture: str
    visible: bool
    spot: list[float]
    arrow: list[float]
    gel: str
    labels: list[tuple[str, float, str]]
    size: int = PIXELS


class Side:
    """A surface as seen from one side; the object's z is up where it can be.

    Parameters
    ----------
    direction
        Unit vector from the object to the camera.
    """

    def __init__(self, surface: Surface, direction: np.ndarray) -> None:
        up = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
        right = np.cross(up, direction)
        right /= np.linalg.norm(right)
        self.surface, self.direction = surface, direction
        self.axes = np.stack([right, np.cross(direction, right), direction])
        self.eye = surface.bounds.mean(axis=0) + DISTANCE * _size(surface) * direction

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return (n, 2) pixels, x right and y down, of (n, 3) points."""
        x, y, z = self.axes @ (points - self.eye).T
        return PIXELS / 2 + FOCAL * np.stack([-x, y], axis=1) / z[:, None]

    def shows(self, point: np.ndarray) -> bool:
        """Whether nothing of the surface hides a point of it."""
        return not self.surface.occluded(self.eye[None], (point + NEAR * (self.eye - point))[None])[0]

    def faces(self) -> np.ndarray:
        """Return (PIXELS, PIXELS) the face of each pixel, -1 beside the object."""
        places = np.arange(PIXELS) + 0.5 - PIXELS / 2
        x, y = np.meshgrid(places, -places)
        rays = np.stack([x, y, np.full_like(x, -FOCAL)], axis=-1).reshape(-1, 3) @ self.axes
        found = self.surface.ray_hits(np.broadcast_to(self.eye, rays.shape), rays).face
        return found.reshape(PIXELS, PIXELS)

    def uri(self) -> str:
        """Return the picture as a data URI, see-through beside the object."""
        faces, normals = self.faces(), self.surface.face_normals @ self.axes.T
        lit = np.clip(normals @ LIGHT * np.where(normals[:, 2] < 0, -1.0, 1.0), 0, 1)
        levels = np.round(1 + (SHADES - 2) * lit).astype(np.uint8)
        return indexed_uri(np.where(faces >= 0, levels[faces], np.uint8(0)), CLAY, transparent=0)


def side_showing(surface: Surface, point: np.ndarray, normal: np.ndarray) -> Side:
    """Return a side that shows a point, obliquely where that is possible, from above before from below.

    A point that none of these sides shows (deep in a vessel) has the side along its normal; ask `shows`.
    """
    across = Side(surface, normal).axes
    for turn in np.argsort(-np.sin(np.arange(TRIED) * 2 * np.pi / TRIED), kind="stable"):
        angle, oblique = turn * 2 * np.pi / TRIED, np.radians(OBLIQUE_DEG)
        local = [np.sin(oblique) * np.cos(angle), np.sin(oblique) * np.sin(angle), np.cos(oblique)]
        side = Side(surface, np.array(local) @ across)
        if side.shows(point):
            return side
    return Side(surface, normal)


def contacts(truth: np.ndarray, products: ObjectProducts) -> list[Contact | None]:
    """Return what is known of each touch shown, drawn; None for one that the touches do not hold.

    Parameters
    ----------
    truth
        (n, height, width, 3) uint8 images of the touches shown.

    Raises
    ------
    FileNotFoundError
        No touches, or no surface.
    FormatError
        One of these products is damaged.
    ValueError
        The surface has no triangles.
    """
    touches = products.arrays("touches", "held_out", *TOUCH_ARRAYS)
    held_out = np.flatnonzero(touches["held_out"])
    if not len(held_out):
        return [None] * len(truth)
    rows = slice(int(held_out[0]), int(held_out[-1]) + 1)
    images = products.arrays("touches", "rgb", rows=rows)["rgb"][held_out - rows.start]
    mesh = products.arrays("objects", "vertices", "faces")
    surface, sensor = Surface(mesh["vertices"], mesh["faces"]), touches.attributes["sensor"]
    drawn: list[Contact | None] = []
    for place in find_touches(truth, images):
        index = None if place is None else held_out[place]
        touch = {name: touches[name][index] for name in TOUCH_ARRAYS}
        drawn.append(None if index is None else _contact(surface, touch, sensor))
    return drawn


def find_touches(truth: np.ndarray, images: np.ndarray) -> list[int | None]:
    """Return which of (n, height, width, 3) images of touches each of `truth` is; None where it is none."""
    if truth.shape[1:] != images.shape[1:]:
        return [None] * len(truth)
    equal = (np.flatnonzero((images == image).all(axis=(1, 2, 3))) for image in truth)
    return [int(found[0]) if len(found) else None for found in equal]


def gel_corners(sensor: Mapping[str, Any]) -> np.ndarray:
    """Return (4, 3) corners of the gel's plane at its apex in the sensor's frame, metres, in turn."""
    apex = np.array(sensor["gel_apex_m"], dtype=np.float64)
    half = np.array([0.0, sensor["gel_width_m"], sensor["gel_height_m"]]) / 2
    signs = np.array([(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1)])
    return apex + signs * half


def _contact(surface: Surface, touch: Mapping[str, np.ndarray], sensor: Mapping[str, Any]) -> Contact:
    point, normal, pose = touch["points"], touch["normals"], touch["sensor_to_object"]
    corners = gel_corners(sensor) @ pose[:3, :3].T + pose[:3, 3]
    side = side_showing(surface, point, normal)
    spot, arrow, *gel = side.project(np.stack([point, point + ARROW * _size(surface) * normal, *corners]))
    labels = [(axis, 1e3 * float(value), "mm") for axis, value in zip("xyz", point, strict=True)]
    labels += [
        ("depth", 1e3 * float(touch["depth_m"]), "mm"),
        ("tilt", float(touch["tilt_deg"]), "°"),
        ("contact area", 1e6 * float(touch["contact_area_m2"]), "mm²"),
    ]
    outline = " ".join(f"{x:.1f},{y:.1f}" for x, y in gel)
    return Contact(
        side.uri(), side.shows(point), spot.round(1).tolist(), arrow.round(1).tolist(), outline, labels
    )


def _size(surface: Surface) -> float:
    """Return the diagonal of the bounding box, metres; 1 for a surface without extent."""
    return float(np.linalg.norm(np.ptp(surface.bounds, axis=0))) or 1.0
