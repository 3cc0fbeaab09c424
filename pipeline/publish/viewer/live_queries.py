"""What the live page asks of an Object File: JSON in, JSON and bytes out."""

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.audio.synthesis.oscillators import HIGHEST_RATIO
from objectfolder.errors import QueryError
from objectfolder.object_file import ObjectFile
from pipeline.publish.viewer.bake import listening_gain

MOST_PIXELS = 1024
LONGEST_S = 10.0
RATES_HZ = (8000.0, 192000.0)

Answer = tuple[dict[str, Any], bytes]


class LiveObject:
    """One Object File behind a page, whose Python opens it by the `path` of the command line.

    Questions are JSON objects; lengths are in metres, angles in degrees, impulses in N s. Every answer is a
    header and bytes. A question that has none raises `QueryError`.

    Raises
    ------
    FormatError
        No Object File, or a damaged one.
    FileNotFoundError
        No such file.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = str(path)
        self.file = ObjectFile.load(path)

    def object(self, _: Mapping[str, Any]) -> Answer:
        """Return what the page shows and needs before the first query."""
        file, description = self.file, self.file.description
        facts = {
            "id": description["object"].get("id"),
            "file": self.path,
            "name": description["object"].get("name") or Path(self.path).name,
            "licence": description["object"].get("licence"),
            "attribution": description["object"].get("attribution"),
            "material": (description["material"] or {}).get("name"),
            "sides_m": np.ptp(file.surface.bounds, axis=0).tolist(),
            "frame": file.frame.to_dict(),
            "reach": float(np.linalg.norm(file.frame.to_unit(file.surface.vertices), axis=1).max()),
            "frequencies": file.modes.frequencies_hz.tolist(),
            "dampings": file.modes.dampings_per_s.tolist(),
            "listeningGain": listening_gain(file),
            "highestRatio": HIGHEST_RATIO,
            "sensor": file.touch.sensor.name,
        }
        return facts, b""

    def render(self, query: Mapping[str, Any]) -> Answer:
        """Return rows of an image of ``resolution``, from ``camera_to_world``.

        It is lit by the lamp at ``light_position`` or, where that is null, in a ``studio``. ``rows`` are the
        first and their number; null for all. ``sub_rays`` may be null, too. The bytes are
        (rows, resolution, 3).
        """
        resolution = int(number_of(query, "resolution", 1, MOST_PIXELS))
        sub_rays = query.get("sub_rays")
        rays = None if sub_rays is None else int(number_of(query, "sub_rays", 1, 1024))
        crop = None
        if query.get("rows") is not None:
            first, count = (int(value) for value in numbers_of(query, "rows", (2,)))
            crop = (first, 0, count, resolution)
        camera = numbers_of(query, "camera_to_world", (4, 4))
        if query.get("light_position") is None:
            studio = str(query.get("studio"))
            image = self.file.pictures(camera, resolution, studio=studio, sub_rays=rays, crop=crop)[0]
        else:
            lamp = numbers_of(query, "light_position", (3,))
            image = self.file.render(camera, lamp, resolution, sub_rays=rays, crop=crop)[0]
        return {"resolution": resolution}, image.tobytes()

    def strike(self, query: Mapping[str, Any]) -> Answer:
        """Strike where a ray (``origin``, ``direction``) meets the object.

        ``along`` may be null, for the direction into the surface; ``duration`` is in seconds, ``sample_rate``
        in hertz. The header says ``missed``, or point, normal and impulse; the bytes are float32 m/s.
        """
        impulse = number_of(query, "impulse", 0, 1000)
        duration = number_of(query, "duration", 1e-3, LONGEST_S)
        rate = number_of(query, "sample_rate", *RATES_HZ)
        along = None if query.get("along") is None else numbers_of(query, "along", (3,))
        hit = self._hit(query)
        if hit is None:
            return {"missed": True}, b""
        point, normal = hit
        push = -normal if along is None else along / _length(along, "along")
        force = impulse * push
        sound = self.file.strike(point, force, duration, rate)[0]
        header = {"point": point.tolist(), "normal": normal.tolist(), "impulse": force.tolist()}
        return header, sound.astype("<f4").tobytes()

    def partials(self, query: Mapping[str, Any]) -> Answer:
        """Return the amplitude (m/s) that an ``impulse`` (N s) at a ``point`` gives each mode.

        Apart from `strike`: what is heard does not wait for what is then drawn.
        """
        point, impulse = numbers_of(query, "point", (3,)), numbers_of(query, "impulse", (3,))
        return {"amplitudes": self.file.mode_velocities(point, impulse)[0].tolist()}, b""

    def press(self, query: Mapping[str, Any]) -> Answer:
        """Press the sensor by ``depth`` where a ray meets the object, at ``tilt`` and ``azimuth``.

        The header says ``missed``, or point, normal, size and labels; the bytes are RGB, then float32 metres
        of indentation.
        """
        depth, tilt, azimuth = (float(numbers_of(query, name, ())) for name in ("depth", "tilt", "azimuth"))
        hit = self._hit(query)
        if hit is None:
            return {"missed": True}, b""
        point, normal = hit
        touch = self.file.press(point, depth, tilt, azimuth)
        height, width = touch.depth_m.shape[1:]
        return {
            "point": point.tolist(),
            "normal": normal.tolist(),
            "height": height,
            "width": width,
            "reachable": bool(touch.reachable[0]),
            "penetration_m": float(touch.penetration_m[0]),
            "first_contact_offset_m": float(touch.first_contact_offset_m[0]),
            "contact_area_m2": float(touch.contact_area_m2[0]),
        }, touch.rgb[0].tobytes() + touch.depth_m[0].astype("<f4").tobytes()

    def warm_images(self) -> None:
        """Compile, or read from the cache, what images need."""
        self.file.pictures(1, 16)

    def warm_contacts(self) -> None:
        """Prepare what contacts need, once."""
        points, normals = self.file.sample_contacts(1, seed=0, reachable=False)
        self.file.strike(points, -normals, 0.01)
        self.file.surface.ray_hits(points + normals, -normals)
        self.file.press(points)

    def _hit(self, query: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray] | None:
        """Return where a ray meets the object, and the normal there on the side it comes from."""
        origin, direction = numbers_of(query, "origin", (3,)), numbers_of(query, "direction", (3,))
        _length(direction, "direction")
        surface = self.file.surface
        hits = surface.ray_hits(origin[None], direction[None])
        if hits.face[0] < 0:
            return None
        normal = surface.normals_at(hits.face, hits.barycentric)[0]
        point = surface.points_at(hits.face, hits.barycentric)[0]
        return point, -normal if normal @ direction > 0 else normal


class LiveObjects:
    """Object Files behind one page: the first is opened at once, others when they are asked for."""

    def __init__(self, paths: Sequence[Path | str]) -> None:
        self._paths, self._opening = paths, threading.Lock()
        self._opened = {0: LiveObject(paths[0])}

    def __getitem__(self, number: int) -> LiveObject:
        """Return one by its place."""
        with self._opening:
            if not 0 <= number < len(self._paths):
                raise QueryError("object", f"there is no {number}", "Choose one of the list.")
            if number not in self._opened:
                self._opened[number] = LiveObject(self._paths[number])
            return self._opened[number]

    def answer(self, question: str, number: int, query: Mapping[str, Any]) -> Answer:
        """Return the answer of an object's method; that of ``object`` lists the names of all objects."""
        header, payload = getattr(self[number], question)(query)
        if question == "object":
            header["objects"] = [Path(path).stem for path in self._paths]
        return header, payload


def numbers_of(query: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return finite numbers of a question."""
    try:
        values = np.array(query[name], dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        values = np.array([np.nan, np.nan])
    if values.shape != shape or not np.isfinite(values).all():
        raise QueryError(name, "missing, of another shape or not finite", f"Give numbers of shape {shape}.")
    return values


def number_of(query: Mapping[str, Any], name: str, low: float, high: float) -> float:
    """Return one number of a question, within `low` to `high`."""
    value = float(numbers_of(query, name, ()))
    if not low <= value <= high:
        raise QueryError(name, f"{value:g} is out of range", f"Give {low:g} to {high:g}.")
    return value


def _length(direction: np.ndarray, name: str) -> float:
    length = float(np.linalg.norm(direction))
    if not length > 0:
        raise QueryError(name, "has no length", "Give a direction.")
    return length
