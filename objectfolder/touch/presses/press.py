"""Press a sensor against a surface: pose, image, indentation, and what is true of the touch."""

from dataclasses import dataclass, replace

import numpy as np

from objectfolder.query_values import point_rows
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.presses.elastic_press import press_elastic
from objectfolder.touch.presses.touches import TOLERANCE_M, Press, Reach, Touches, saturation_depth_m
from objectfolder.touch.rendering.simulator import Near, Simulator, TouchImage
from objectfolder.touch.sensor.sensor import Sensor


def press(
    surface: Surface | FacePatches, sensor: Sensor, points: np.ndarray, query: Press | None = None
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
    query
        Depth or force, angles, contact model and samples; a millimetre along the normal if None.

    Raises
    ------
    QueryError
        Points that are not (n, 3) or not finite, a depth, force or tilt out of range, an unknown contact
        model, a force asked of the rigid one, both a depth and a force.
    SimulationError
        An elastic contact that is not found, see `objectfolder.touch.elastic.contact_problem`.

    Examples
    --------
    A box of two centimetres, pressed by a DIGIT in the middle of its top:

    >>> import numpy as np
    >>> from objectfolder.surface import Surface
    >>> from objectfolder.touch import Press, Sensor
    >>> vertices = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 0.02
    >>> faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    >>> faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    >>> box = Surface(vertices, np.array(faces))
    >>> touch = press(box, Sensor(), np.array([[0.01, 0.01, 0.02]]), Press(depth_m=0.0005))
    >>> touch.rgb.shape, bool(touch.reachable[0]), float(touch.penetration_m[0])
    ((1, 160, 120, 3), True, 0.0005)
    >>> touch.normals.round(6).tolist()
    [[0.0, 0.0, 1.0]]
    """
    query = Press() if query is None else query
    patches = surface if isinstance(surface, FacePatches) else FacePatches(surface)
    points = point_rows(points, "points")
    simulator = Simulator(patches, sensor, query.samples)
    touches = Touches.empty(len(points), sensor)
    touches.points[:], touches.normals[:], poses = simulator.stand(points, *query.angles(len(points)))
    if query.contact_model == "elastic":
        press_elastic(simulator, patches, sensor, query, poses, touches)
        return touches
    depths = query.depths(len(points), sensor.maximum_depth_m)
    for index, pose in enumerate(poses):
        _press_one(simulator, sensor, pose, float(depths[index]), touches, index)
    return touches


def render_poses(
    surface: Surface | FacePatches, sensor: Sensor, sensor_to_object: np.ndarray, samples: int = 2
) -> list[TouchImage]:
    """See through the gel at poses (n, 4, 4), wherever they are: one image a pose."""
    patches = surface if isinstance(surface, FacePatches) else FacePatches(surface)
    simulator = Simulator(patches, sensor, samples)
    poses = np.asarray(sensor_to_object, dtype=np.float64).reshape(-1, 4, 4)
    return [simulator.see(pose, simulator.approach(pose, 0.0)) for pose in poses]


def reach(
    surface: Surface | FacePatches, sensor: Sensor, points: np.ndarray, query: Press, rolls: int
) -> "Reach":
    """Try presses at several rolls of the sensor, without images.

    Parameters
    ----------
    surface, sensor, points
        As for `press`.
    query
        Depth, tilt and azimuth, and the roll to begin with; the contact is rigid.
    rolls
        How many, evenly round a turn.

    Raises
    ------
    QueryError
        As for `press`.
    """
    patches = surface if isinstance(surface, FacePatches) else FacePatches(surface)
    simulator = Simulator(patches, sensor, 1)
    points = point_rows(points, "points")
    depths = query.depths(len(points), sensor.maximum_depth_m)
    tilt, azimuth, first = query.angles(len(points))
    turns = np.arange(rolls) * (2 * np.pi / rolls)
    reachable = np.zeros((len(points), rolls), dtype=bool)
    for column, turn in enumerate(turns):
        _, _, poses = simulator.stand(points, tilt, azimuth, first + turn)
        for row, pose in enumerate(poses):
            reachable[row, column] = _stand(simulator, pose, float(depths[row])).reachable
    return Reach(np.degrees(first[:, None] + turns), reachable)


@dataclass(frozen=True)
class _Stand:
    """Where a press to a depth ends: pose, faces near it, and what the labels say."""

    pose: np.ndarray
    near: Near
    offset_m: float
    obstructed: bool
    reachable: bool


def _stand(simulator: Simulator, first_touch: np.ndarray, depth: float) -> _Stand:
    """Advance from the pose of first touch by `depth` from the first contact on."""
    near = simulator.approach(first_touch, -depth)
    # The touched point itself is on the gel, but for rounding.
    offset = near.greatest
    advance = depth - offset
    pose = first_touch.copy()
    pose[:3, 3] += advance * pose[:3, 0]
    # Backing off may bring other parts between camera and gel.
    near = near.advanced(advance) if advance >= 0 else simulator.approach(pose, 0.0)
    obstructed = near.greatest > depth + TOLERANCE_M
    reachable = not obstructed and offset <= depth + TOLERANCE_M and not simulator.meets_housing(pose)
    return _Stand(pose, near, offset, obstructed, reachable)


def _press_one(
    simulator: Simulator, sensor: Sensor, first_touch: np.ndarray, depth: float, touches: Touches, index: int
) -> None:
    """Advance from the pose of first touch, render, and fill row `index` of `touches`."""
    stand = _stand(simulator, first_touch, depth)
    near, blocked = stand.near, stand.obstructed
    touches.sensor_to_object[index] = stand.pose
    touches.first_contact_offset_m[index] = stand.offset_m
    touches.penetration_m[index] = 0.0 if blocked else depth
    touches.saturated[index] = not blocked and depth >= saturation_depth_m(sensor) - TOLERANCE_M
    touches.reachable[index] = stand.reachable
    if blocked:
        near = replace(near, bounds=np.full_like(near.bounds, -np.inf))
    image = simulator.see(stand.pose, near)
    touches.rgb[index], touches.depth_m[index], touches.mask[index] = image.rgb, image.depth, image.mask
    touches.contact_area_m2[index] = image.contact_area_m2
