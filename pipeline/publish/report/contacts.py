"""Where on the object the touches of a page were made, drawn on its surface in plain clay."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from objectfolder.surface.surface import Surface
from pipeline.intake.add.preview_views import LIGHT, axes_towards, look
from pipeline.publish.report.object_products import ObjectProducts
from pipeline.publish.report.pictures import indexed_uri

PIXELS = 150
# In diagonals of the bounding box: the side of a picture, and how far out the arrow that shows the sensor's
# way begins.
WIDTH, ARROW = 1.2, 0.22
UP = np.array([0.0, 0.0, 1.0])
# Directions to the eye, from above before from below.
TURNS = np.radians(np.arange(0, 360, 45) + 22.5)
SIDES = np.array([(np.cos(turn), np.sin(turn), height) for height in (0.7, -0.7) for turn in TURNS])
SIDES /= np.linalg.norm(SIDES, axis=1, keepdims=True)
# Least cosine between the surface's normal and the direction to the eye where a contact is well in sight.
LEAST_FACING = 0.3
# In diagonals: what hides a point lies farther before it than this.
NEAR = 0.004
# Grey of each level: nothing beside the object, then from shadow to light.
SHADES = 64
CLAY = np.repeat(np.linspace(70, 225, SHADES)[:, None], 3, axis=1)
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
    """A surface as seen from one side, drawn to scale; the object's z is up.

    Parameters
    ----------
    eye
        Direction from the object to the eye.
    """

    def __init__(self, surface: Surface, eye: np.ndarray) -> None:
        self.surface, self.axes = surface, axes_towards(eye, UP)
        self.direction, self._centre = self.axes[2], surface.bounds.mean(axis=0)
        self._far, self._scale = _size(surface), PIXELS / (WIDTH * _size(surface))

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return (n, 2) pixels, x right and y down, of (n, 3) points."""
        return PIXELS / 2 + self._scale * ((points - self._centre) @ self.axes[:2].T) * (1, -1)

    def faces(self) -> np.ndarray:
        """Return (PIXELS, PIXELS) the face of each pixel, -1 beside the object."""
        hits = look(self.surface, self.axes, PIXELS / self._scale, PIXELS, self._far)
        return hits.face.reshape(PIXELS, PIXELS)

    @cached_property
    def uri(self) -> str:
        """The picture as a data URI, see-through beside the object."""
        faces, normals = self.faces(), self.surface.face_normals @ self.axes.T
        lit = np.clip(normals @ LIGHT * np.where(normals[:, 2] < 0, -1.0, 1.0), 0, 1)
        levels = np.round(1 + (SHADES - 2) * lit).astype(np.uint8)
        return indexed_uri(np.where(faces >= 0, levels[faces], np.uint8(0)), CLAY, transparent=0)


def in_sight(surface: Surface, points: np.ndarray, eyes: np.ndarray) -> np.ndarray:
    """Return (sides, n) whether nothing of the surface hides (n, 3) points from (sides, 3) directions."""
    far = _size(surface)
    starts = points + NEAR * far * eyes[:, None]
    hidden = surface.occluded(starts.reshape(-1, 3), (starts + far * eyes[:, None]).reshape(-1, 3))
    return ~hidden.reshape(len(eyes), len(points))


def sides_showing(surface: Surface, points: np.ndarray, normals: np.ndarray) -> list[tuple[Side, bool]]:
    """Return a side for each of (n, 3) points, few sides in all, and whether it shows the point."""
    seen = in_sight(surface, points, SIDES)
    well = seen & (SIDES @ normals.T > LEAST_FACING)
    chosen, left = np.zeros(len(points), dtype=int), well.any(axis=0)
    while left.any():
        best = int(np.argmax((well & left).sum(axis=1)))
        chosen[well[best] & left] = best
        left &= ~well[best]
    sides = {index: Side(surface, SIDES[index]) for index in set(chosen.tolist())}
    return [(sides[index], bool(seen[index, row])) for row, index in enumerate(chosen.tolist())]


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
    places = find_touches(truth, images)
    known = [held_out[place] for place in places if place is not None]
    sides = sides_showing(surface, touches["points"][known], touches["normals"][known])
    drawn = {
        index: _contact(*side, {name: touches[name][index] for name in TOUCH_ARRAYS}, sensor)
        for index, side in zip(known, sides, strict=True)
    }
    return [None if place is None else drawn[held_out[place]] for place in places]


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


def _contact(
    side: Side, visible: bool, touch: Mapping[str, np.ndarray], sensor: Mapping[str, Any]
) -> Contact:
    point, normal, pose = touch["points"], touch["normals"], touch["sensor_to_object"]
    corners = gel_corners(sensor) @ pose[:3, :3].T + pose[:3, 3]
    start = point + ARROW * _size(side.surface) * normal
    spot, arrow, *gel = side.project(np.stack([point, start, *corners]))
    labels = [(axis, 1e3 * float(value), "mm") for axis, value in zip("xyz", point, strict=True)]
    labels += [
        ("depth", 1e3 * float(touch["depth_m"]), "mm"),
        ("tilt", float(touch["tilt_deg"]), "°"),
        ("contact area", 1e6 * float(touch["contact_area_m2"]), "mm²"),
    ]
    outline = " ".join(f"{x:.1f},{y:.1f}" for x, y in gel)
    return Contact(side.uri, visible, spot.round(1).tolist(), arrow.round(1).tolist(), outline, labels)


def _size(surface: Surface) -> float:
    """Return the diagonal of the bounding box, metres; 1 for a surface without extent."""
    return float(np.linalg.norm(np.ptp(surface.bounds, axis=0))) or 1.0
