"""Where on the object the touches of a report were made: found in the ground truth, drawn on the surface."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from pipeline.publish.report.archive import Archive
from pipeline.publish.report.surface_picture import PIXELS, Picture, Surface, pictures_showing

# Of the object's diagonal: how far out the arrow that shows the sensor's way begins.
ARROW = 0.22
TOUCH_ARRAYS = ("points", "normals", "sensor_to_object", "depth_m", "tilt_deg", "contact_area_m2")


@dataclass(frozen=True)
class Contact:
    """One touch, drawn: positions are pixels of a square picture of `size`.

    Parameters
    ----------
    picture
        The object, as a data URI.
    visible
        Whether the contact point is in sight.
    x, y
        Where the contact point lies.
    from_x, from_y
        Where the arrow along the outward normal begins.
    gel
        Corners of the gel's plane at its apex, as an SVG polygon's points.
    labels
        What is known of the touch: name, value with unit.
    """

    picture: str
    visible: bool
    x: float
    y: float
    from_x: float
    from_y: float
    gel: str
    labels: list[tuple[str, float, str]]
    size: int = PIXELS


def read_surface(objects: Archive) -> Surface:
    """Return the surface of an object's product.

    Raises
    ------
    FormatError
        A product that is damaged, or whose arrays are no triangles: what draws them checks no index.
    """
    vertices = np.ascontiguousarray(objects.array("vertices"), dtype=np.float64)
    faces = np.ascontiguousarray(objects.array("faces"), dtype=np.int64)
    triangles = vertices.shape[1:] == faces.shape[1:] == (3,) and len(vertices) and len(faces)
    if not triangles or not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise FormatError(str(objects.path), "its vertices and faces are no triangles")
    return Surface(vertices, faces)


def find_touches(fidelity: Archive, touches: Archive) -> list[int | None]:
    """Return, for each touch shown, which of the truth's touches it is; None where it is none of them.

    Stored images are compared by size and checksum, and by their pixels where that finds none.
    """
    shown = fidelity.item_sums("touch_truth")
    stored: dict[tuple[int, int], int] = {}
    for index, sums in enumerate(touches.item_sums("rgb")):
        if sums is not None:
            stored.setdefault(sums, index)
    found = [None if sums is None else stored.get(sums) for sums in shown]
    if None in found:
        images, held_out = touches.array("rgb"), touches.array("held_out")
        for place, truth in enumerate(fidelity.array("touch_truth")):
            if truth.shape != images.shape[1:]:
                continue
            equal = np.flatnonzero(held_out & (images == truth).all(axis=(1, 2, 3)))
            found[place] = int(equal[0]) if found[place] is None and len(equal) else found[place]
    return found


def contacts(fidelity: Archive, touches: Archive, objects: Archive) -> list[Contact | None]:
    """Return what is known of each touch shown, drawn; None for one that the truth does not hold.

    Raises
    ------
    FormatError
        A product that is damaged.
    """
    found = find_touches(fidelity, touches)
    if not any(index is not None for index in found):
        return [None] * len(found)
    surface = read_surface(objects)
    values = {name: touches.array(name) for name in TOUCH_ARRAYS}
    sensor = touches.attributes().get("sensor")
    if len({len(value) for value in values.values()}) != 1 or not isinstance(sensor, dict):
        raise FormatError(str(touches.path), "its touches do not agree in number, or have no sensor")
    rows = [index for index in found if index is not None]
    drawn = iter(pictures_showing(surface, values["points"][rows], values["normals"][rows]))
    return [
        None if index is None else _contact(next(drawn), {k: v[index] for k, v in values.items()}, sensor)
        for index in found
    ]


def gel_corners(sensor: dict[str, Any]) -> np.ndarray:
    """Return (4, 3) corners of the gel's plane at its apex in the sensor's frame, metres, in turn."""
    apex = np.array(sensor["gel_apex_m"], dtype=np.float64)
    half = np.array([sensor["gel_width_m"], sensor["gel_height_m"]]) / 2
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return apex + np.concatenate([np.zeros((4, 1)), signs * half], axis=1)


def _contact(drawn: Picture, touch: dict[str, np.ndarray], sensor: dict[str, Any]) -> Contact:
    point, normal, pose = touch["points"], touch["normals"], touch["sensor_to_object"]
    corners = gel_corners(sensor) @ pose[:3, :3].T + pose[:3, 3]
    start = point + ARROW * drawn.surface.size_m * normal
    pixels, _ = drawn.project(np.stack([point, start, *corners]))
    (x, y), (from_x, from_y) = pixels[:2].round(1).tolist()
    labels = [
        ("x", 1e3 * point[0], "mm"),
        ("y", 1e3 * point[1], "mm"),
        ("z", 1e3 * point[2], "mm"),
        ("depth", 1e3 * touch["depth_m"], "mm"),
        ("tilt", touch["tilt_deg"], "°"),
        ("contact area", 1e6 * touch["contact_area_m2"], "mm²"),
    ]
    gel = " ".join(f"{column:.1f},{row:.1f}" for column, row in pixels[2:])
    facts = [(name, float(value), unit) for name, value, unit in labels]
    return Contact(drawn.uri, drawn.shows(point), x, y, from_x, from_y, gel, facts)
