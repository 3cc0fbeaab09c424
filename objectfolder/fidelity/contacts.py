"""Where on the object touches were made, on pictures of its surface in plain clay."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from objectfolder.products.store import Product
from objectfolder.surface.parallel_views import LIGHT_DIRECTION, axes_towards, look
from objectfolder.surface.surface import Surface

PIXELS = 150
# In diagonals of the bounding box: the side of a picture, and how far out the arrow that shows the sensor's
# way begins.
PICTURE_SIDE, ARROW = 1.2, 0.22
UP = np.array([0.0, 0.0, 1.0])
# Directions to the eye, from above before from below.
TURNS = np.radians(np.arange(0, 360, 45) + 22.5)
SIDES = np.array([(np.cos(turn), np.sin(turn), height) for height in (0.7, -0.7) for turn in TURNS])
SIDES /= np.linalg.norm(SIDES, axis=1, keepdims=True)
# Least cosine between the surface's normal and the direction to the eye where a contact is well in sight.
LEAST_FACING = 0.3
# In diagonals: what hides a point lies farther before it than this.
HIDING_DISTANCE = 0.004
DARKEST, CLAY_GREY = 70, 225  # grey of clay


class ContactPictures(NamedTuple):
    """Where n touches were made; positions are pixels, x right and y down, of pictures of `PIXELS` a side.

    Parameters
    ----------
    sides
        (k, PIXELS, PIXELS, 4) uint8 RGBA, the object from the sides that the touches need.
    side
        (n,) uint8, which of them shows each touch.
    visible
        (n,) bool, whether the contact point is in sight there.
    pixels
        (n, 6, 2) float32: the contact point, where the arrow along the outward normal begins, and the corners
        of the gel's plane at its apex.
    """

    sides: np.ndarray
    side: np.ndarray
    visible: np.ndarray
    pixels: np.ndarray


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
        self._far, self._scale = _size(surface), PIXELS / (PICTURE_SIDE * _size(surface))

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return (n, 2) pixels, x right and y down, of (n, 3) points."""
        return PIXELS / 2 + self._scale * ((points - self._centre) @ self.axes[:2].T) * (1, -1)

    def faces(self) -> np.ndarray:
        """Return (PIXELS, PIXELS) the face of each pixel, -1 beside the object."""
        hits = look(self.surface, self.axes, PIXELS / self._scale, PIXELS, self._far)
        return hits.face.reshape(PIXELS, PIXELS)

    def picture(self) -> np.ndarray:
        """Return (PIXELS, PIXELS, 4) uint8 RGBA in plain clay, see-through beside the object."""
        faces, normals = self.faces(), self.surface.face_normals @ self.axes.T
        lit = np.clip(normals @ LIGHT_DIRECTION * np.where(normals[:, 2] < 0, -1.0, 1.0), 0, 1)
        drawn = np.zeros((PIXELS, PIXELS, 4), np.uint8)
        drawn[faces >= 0, :3] = (DARKEST + (CLAY_GREY - DARKEST) * lit[faces[faces >= 0], None]).round()
        drawn[faces >= 0, 3] = 255
        return drawn


def in_sight(surface: Surface, points: np.ndarray, eyes: np.ndarray) -> np.ndarray:
    """Return (sides, n) whether nothing of the surface hides (n, 3) points from (sides, 3) directions."""
    far = _size(surface)
    starts = points + HIDING_DISTANCE * far * eyes[:, None]
    hidden = surface.occluded(starts.reshape(-1, 3), (starts + far * eyes[:, None]).reshape(-1, 3))
    return ~hidden.reshape(len(eyes), len(points))


def sides_showing(surface: Surface, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which of `SIDES` shows each of (n, 3) points, few in all, and whether it is in sight."""
    visible = in_sight(surface, points, SIDES)
    well = visible & (SIDES @ normals.T > LEAST_FACING)
    chosen, rest = np.zeros(len(points), dtype=int), well.any(axis=0)
    while rest.any():
        best = int(np.argmax((well & rest).sum(axis=1)))
        chosen[well[best] & rest] = best
        rest &= ~well[best]
    return chosen, visible[chosen, np.arange(len(points))]


def contact_pictures(surface: Surface, touches: Product, held_out: np.ndarray) -> ContactPictures:
    """Return where those of the touches were made that (n,) bool `held_out` names.

    Parameters
    ----------
    touches
        What `simulate_touches` returned.
    """
    points, normals, poses = (touches[name][held_out] for name in ("points", "normals", "sensor_to_object"))
    chosen, visible = sides_showing(surface, points, normals)
    corners = (
        gel_corners(touches.attributes["sensor"]) @ poses[:, :3, :3].swapaxes(1, 2) + poses[:, None, :3, 3]
    )
    starts = points + ARROW * _size(surface) * normals
    places = np.concatenate([points[:, None], starts[:, None], corners], axis=1)
    used, side = np.unique(chosen, return_inverse=True)
    sides = [Side(surface, SIDES[index]) for index in used]
    pixels = np.array([sides[index].project(each) for index, each in zip(side, places, strict=True)])
    return ContactPictures(
        np.array([view.picture() for view in sides]).reshape(-1, PIXELS, PIXELS, 4),
        side.astype(np.uint8),
        visible,
        pixels.reshape(-1, 6, 2).astype(np.float32),
    )


def gel_corners(sensor: Mapping[str, Any]) -> np.ndarray:
    """Return (4, 3) corners of the gel's plane at its apex in the sensor's frame, metres, in turn."""
    apex = np.array(sensor["gel_apex_m"], dtype=np.float64)
    half = np.array([0.0, sensor["gel_width_m"], sensor["gel_height_m"]]) / 2
    signs = np.array([(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1)])
    return apex + signs * half


def _size(surface: Surface) -> float:
    """Return the diagonal of the bounding box, metres; 1 for a surface without extent."""
    return float(np.linalg.norm(np.ptp(surface.bounds, axis=0))) or 1.0
