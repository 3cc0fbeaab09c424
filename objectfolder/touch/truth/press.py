"""Press a sensor against a surface: pose, image, indentation, and what is true of the touch."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.rendering.backends import Simulator, make_simulator
from objectfolder.touch.sensor.sensor import Sensor

TOLERANCE_M = 1e-6
DEFAULT_DEPTH_M = 0.001


@dataclass(frozen=True)
class Touches:
    """n touches.

    Parameters
    ----------
    rgb
        (n, height, width, 3) uint8, without noise.
    depth
        (n, height, width) float32 metres: how far the object, where a pixel sees it, lies inside the
        undeformed gel, along the sensor's axis; the mean over a pixel's samples, 0 where there is none.
    mask
        (n, height, width) bool: at least half of the pixel's samples see the object in the gel.
    sensor_to_object
        (n, 4, 4) float64 pose, metres.
    points, normals
        (n, 3) float64: the touched points of the surface and its mean normals over the contact radius.
    reachable
        (n,) bool: the gel touches the asked point before it is pressed further than asked elsewhere, and
        neither the housing nor the room between camera and gel holds a part of the object.
    first_contact_offset_m
        (n,) float64: how long before the asked point another part of the object meets the gel; the asked
        point itself is `penetration_m - first_contact_offset_m` deep in it (outside where negative).
    penetration_m
        (n,) float64: deepest indentation of the gel by any part of the object, along the sensor's axis.
        It equals the depth asked for, or 0 where the sensor cannot stand. `depth` never shows more.
    contact_area_m2
        (n,) float64: area of the object's surface that the camera sees in the gel.
    saturated
        (n,) bool: the gel is pressed as far as it goes, to the sensor's `maximum_depth_m` or to the camera's
        near plane; a larger force would not press it further.
    force_n
        (n,) float64 newtons: force along the sensor's axis; not a number under the rigid model, whose gel
        gives way without any.
    """

    rgb: np.ndarray
    depth: np.ndarray
    mask: np.ndarray
    sensor_to_object: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    reachable: np.ndarray
    first_contact_offset_m: np.ndarray
    penetration_m: np.ndarray
    contact_area_m2: np.ndarray
    saturated: np.ndarray
    force_n: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def empty(cls, count: int, sensor: Sensor) -> "Touches":
        """`count` touches to be filled in."""
        image = (count, sensor.image_height, sensor.image_width)
        return cls(
            rgb=np.zeros((*image, 3), dtype=np.uint8),
            depth=np.zeros(image, dtype=np.float32),
            mask=np.zeros(image, dtype=bool),
            sensor_to_object=np.zeros((count, 4, 4)),
            points=np.zeros((count, 3)),
            normals=np.zeros((count, 3)),
            reachable=np.zeros(count, dtype=bool),
            first_contact_offset_m=np.zeros(count),
            penetration_m=np.zeros(count),
            contact_area_m2=np.zeros(count),
            saturated=np.zeros(count, dtype=bool),
            force_n=np.full(count, np.nan),
        )


def press(
    surface: Surface | FacePatches,
    sensor: Sensor,
    points: np.ndarray,
    *,
    depth_m: float | np.ndarray | None = None,
    force_n: float | np.ndarray | None = None,
    tilt_deg: float | np.ndarray = 0.0,
    azimuth_deg: float | np.ndarray = 0.0,
    samples: int = 2,
    contact: str = "rigid",
    backend: str | None = None,
) -> Touches:
    """Press the sensor against points of a surface until its gel is indented by a stated depth.

    The sensor comes along its axis, which opposes the contact normal (tilted where asked). From its
    first contact with any part of the object under the gel it goes on by `depth_m`: no part is ever
    pressed in deeper. Every touch is computed by itself, so that batches answer as single queries do.

    Parameters
    ----------
    surface
        Metres. `FacePatches(surface)` saves preparing it again at each call.
    points
        (n, 3) on the surface, object frame, metres; the nearest points of the surface are touched.
    depth_m
        From 0 to the sensor's `maximum_depth_m`; a number or (n,). One millimetre where neither a depth nor
        a force is asked for.
    force_n
        Instead of a depth, the force to press with, newtons, under the elastic model; a number or (n,).
    tilt_deg, azimuth_deg
        Lean of the sensor, 0 up to 45 degrees, and its direction, counted from the image's right towards
        its top; numbers or (n,).
    samples
        Samples along each side of a pixel, against aliasing.
    contact
        ``"rigid"``: the object shows through a gel that gives way where it is, as in TACTO; ``"elastic"``:
        the gel deforms as an elastic solid and bears a force, see `objectfolder.touch.elastic`.
    backend
        ``"compiled"`` or ``"reference"``; by default as `backends.choose_backend` says.

    Raises
    ------
    QueryError
        Points that are not (n, 3) or not finite, a depth or tilt out of range, an unknown contact model,
        a force asked of the rigid one.
    """
    patches = surface if isinstance(surface, FacePatches) else FacePatches(surface)
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise QueryError("points", f"shape {points.shape} or values are not (n, 3) finite coordinates")
    if contact == "elastic":
        from objectfolder.touch.elastic import press_elastic

        if depth_m is None and force_n is None:
            depth_m = DEFAULT_DEPTH_M
        return press_elastic(
            patches, sensor, points, depth_m, force_n, tilt_deg, azimuth_deg, samples, backend=backend
        )
    if contact != "rigid":
        raise QueryError("contact", f"{contact!r}", "Use 'rigid' or 'elastic'.")
    if force_n is not None:
        raise QueryError("force_n", "a rigid contact bears no force", "Ask with contact='elastic'.")
    depth_m = DEFAULT_DEPTH_M if depth_m is None else depth_m
    depth = per_touch("depth_m", depth_m, len(points), sensor.maximum_depth_m)
    tilt = np.radians(per_touch("tilt_deg", tilt_deg, len(points), 45.0))
    azimuth = np.radians(per_touch("azimuth_deg", azimuth_deg, len(points), None))
    simulator = make_simulator(backend, patches, sensor, samples)
    touches = Touches.empty(len(points), sensor)
    touches.points[:], touches.normals[:], poses = simulator.stand(points, tilt, azimuth)
    for index, pose in enumerate(poses):
        _press_one(simulator, sensor, pose, float(depth[index]), touches, index)
    return touches


def press_in_chunks(
    surface: Surface | FacePatches,
    sensor: Sensor,
    points: np.ndarray,
    *,
    depth_m: float | np.ndarray | None = None,
    force_n: float | np.ndarray | None = None,
    tilt_deg: float | np.ndarray = 0.0,
    azimuth_deg: float | np.ndarray = 0.0,
    samples: int = 2,
    contact: str = "rigid",
    backend: str | None = None,
    chunk: int = 256,
) -> Iterator[Touches]:
    """Yield the touches of `press`, `chunk` at a time (about 40 MB at 256), for any number of points."""
    patches = surface if isinstance(surface, FacePatches) else FacePatches(surface)
    points = np.asarray(points, dtype=np.float64)
    asked = {"depth_m": depth_m, "force_n": force_n, "tilt_deg": tilt_deg, "azimuth_deg": azimuth_deg}
    each = {
        name: per_touch(name, value, len(points), None) for name, value in asked.items() if value is not None
    }
    for start in range(0, len(points), chunk):
        part = slice(start, start + chunk)
        rows = {name: values[part] for name, values in each.items()}
        yield press(patches, sensor, points[part], **rows, samples=samples, contact=contact, backend=backend)


def saturation_depth_m(sensor: Sensor) -> float:
    """Deepest indentation of the gel, metres: its limit, or where the camera's near plane ends it."""
    clear = sensor.gel_apex_m[0] - sensor.camera_position_m[0] - sensor.near_m
    return min(sensor.maximum_depth_m, clear)


def per_touch(name: str, value: float | np.ndarray, count: int, highest: float | None) -> np.ndarray:
    """Return a number, or one a touch, as (count,) float64.

    Raises
    ------
    QueryError
        Another shape, values that are not finite, or, where `highest` is given, outside 0 .. `highest`.
    """
    values = np.asarray(value, dtype=np.float64)
    if values.shape not in ((), (count,)):
        raise QueryError(name, f"shape {values.shape}, expected a number or ({count},)")
    if not np.isfinite(values).all():
        raise QueryError(name, "not finite")
    if highest is not None and values.size and not (values.min() >= 0 and values.max() <= highest):
        worst = values.ravel()[np.argmax(np.abs(values - highest / 2))]
        raise QueryError(name, f"{worst} is out of range", f"Ask for 0 to {highest}.")
    return np.broadcast_to(values, (count,))


def _press_one(
    simulator: Simulator, sensor: Sensor, first_touch: np.ndarray, depth: float, touches: Touches, index: int
) -> None:
    """Advance from the pose of first touch, render, and fill row `index` of `touches`."""
    near = simulator.approach(first_touch, -depth)
    # The touched point itself is on the gel, but for rounding.
    offset = near.greatest
    advance = depth - offset
    pose = first_touch.copy()
    pose[:3, 3] += advance * pose[:3, 0]
    # Backing off may bring other parts between camera and gel.
    near = near.advanced(advance) if advance >= 0 else simulator.approach(pose, 0.0)
    obstructed = near.greatest > depth + TOLERANCE_M
    touches.sensor_to_object[index] = pose
    touches.first_contact_offset_m[index] = offset
    touches.penetration_m[index] = 0.0 if obstructed else depth
    touches.saturated[index] = not obstructed and depth >= saturation_depth_m(sensor) - TOLERANCE_M
    touches.reachable[index] = (
        not obstructed and offset <= depth + TOLERANCE_M and not simulator.meets_housing(pose)
    )
    if obstructed:
        near.bounds[:] = -np.inf
    touches.contact_area_m2[index] = simulator.see(
        pose, near, touches.rgb[index], touches.depth[index], touches.mask[index]
    )
