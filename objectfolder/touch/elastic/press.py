"""Press an elastic gel against a surface: to a depth or with a force, and see how the gel deforms."""

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.height_field import gap_field
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.elastic.contact_problem import Contact, solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.image import membrane_image
from objectfolder.touch.elastic.membrane import Membrane
from objectfolder.touch.elastic.object_slopes import object_slopes
from objectfolder.touch.rendering.backends import make_simulator
from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.truth.press import TOLERANCE_M, Touches, per_touch, saturation_depth_m

# About what a pixel of 120 x 160 shows of a DIGIT's gel.
DEFAULT_CELL_M = 0.03 / 192


def gel_elastomer(sensor: Sensor) -> Elastomer:
    """The gel of a sensor as a layer bonded to its backing."""
    return Elastomer(sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio, sensor.gel_thickness_m)


def greatest_depth_m(sensor: Sensor) -> float:
    """Depth at which an elastic gel is saturated, metres: the sensor's own, or that of the backing."""
    return min(saturation_depth_m(sensor), sensor.gel_thickness_m)


def press_elastic(
    surface: Surface | FacePatches,
    sensor: Sensor,
    points: np.ndarray,
    depth_m: float | np.ndarray | None = None,
    force_n: float | np.ndarray | None = None,
    tilt_deg: float | np.ndarray = 0.0,
    azimuth_deg: float | np.ndarray = 0.0,
    samples: int = 2,
    *,
    cell_m: float = DEFAULT_CELL_M,
    backend: str | None = None,
) -> Touches:
    """Press the sensor's gel, an elastic layer bonded to its backing, against points of a rigid surface.

    The sensor stands and comes on as under `objectfolder.touch.truth.press.press`. The curved gel is taken
    as a flat layer whose distance to the object is the difference of their heights, as Hertz did, and
    friction as none; elasticity is linear. The pressure follows by `solve_contact`, and the image shows the
    deformed gel: it follows the object where they touch, and bends away round it.

    Parameters
    ----------
    surface, sensor, points, tilt_deg, azimuth_deg, samples
        As `press` takes them.
    depth_m
        How far the sensor goes on from its first contact, 0 to `greatest_depth_m`; a number or (n,).
    force_n
        Instead of a depth, newtons, 0 or more; a number or (n,).
    cell_m
        About the size of the cells of gel that pressure is constant on. Contacts less than four cells in
        radius are a few per cent off.
    backend
        See `objectfolder.touch.rendering.backends.choose_backend`.

    Returns
    -------
    Touches
        As of `press`, but: ``depth`` is how far the gel that a pixel sees is displaced along the sensor's
        axis, in contact or not, negative where it bulges out; ``mask`` is where the gel is touched;
        ``contact_area_m2`` is the area of all cells of gel in contact; ``penetration_m`` is how far the
        object lies in the undeformed gel; ``force_n`` is what the gel bears, less than asked for where it
        is saturated before.

    Raises
    ------
    QueryError
        Points that are not (n, 3) or not finite, a depth, force or tilt out of range, not one of depth and
        force, cells that are not positive.
    SimulationError
        A contact that is not found, see `solve_contact`.
    """
    patches = surface if isinstance(surface, FacePatches) else FacePatches(surface)
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise QueryError("points", f"shape {points.shape} or values are not (n, 3) finite coordinates")
    if (depth_m is None) == (force_n is None):
        raise QueryError("depth_m, force_n", "both or neither given", "Ask for one of them.")
    if not 0 < cell_m <= min(sensor.gel_width_m, sensor.gel_height_m) / 2:
        raise QueryError("cell_m", f"{cell_m}", "It must be positive, and much smaller than the gel.")
    depth = force = None
    if depth_m is not None:
        depth = per_touch("depth_m", depth_m, len(points), greatest_depth_m(sensor))
    if force_n is not None:
        force = per_touch("force_n", force_n, len(points), None)
        if (force < 0).any():
            raise QueryError("force_n", f"{force.min()} is below 0", "A gel does not pull.")
    tilt = np.radians(per_touch("tilt_deg", tilt_deg, len(points), 45.0))
    azimuth = np.radians(per_touch("azimuth_deg", azimuth_deg, len(points), None))
    shape = max(2, round(sensor.gel_height_m / cell_m)), max(2, round(sensor.gel_width_m / cell_m))
    simulator = make_simulator(backend, patches, sensor, samples)
    grid = ray_grid(sensor, samples)
    touches = Touches.empty(len(points), sensor)
    touches.points[:], touches.normals[:], poses = simulator.stand(points, tilt, azimuth)
    for index, first_touch in enumerate(poses):
        # Another part of the object may meet the gel before the asked point does.
        offset = simulator.approach(first_touch, 0.0).greatest
        start = _advanced(first_touch, -offset)
        obstructed = simulator.approach(start, 0.0).greatest > TOLERANCE_M
        gap = gap_field(patches, sensor, start, shape, backend=backend)
        if obstructed:
            gap = np.full(shape, np.inf)
        contact = _gel_contact(
            gap,
            sensor,
            0.0 if obstructed else None if depth is None else float(depth[index]),
            0.0 if force is None else float(force[index]),
        )
        reached = contact.indentation_m
        pose = _advanced(start, reached if depth is None else float(depth[index]))
        slopes = object_slopes(patches, sensor, start, gap, contact, backend)
        touches.rgb[index], touches.depth[index], touches.mask[index] = membrane_image(
            Membrane.of(contact, sensor, slopes), sensor, grid, backend
        )
        touches.sensor_to_object[index] = pose
        touches.first_contact_offset_m[index] = offset
        touches.penetration_m[index] = reached
        touches.contact_area_m2[index] = contact.contact_area_m2
        touches.force_n[index] = contact.force_n
        touches.saturated[index] = reached >= greatest_depth_m(sensor) - TOLERANCE_M
        touches.reachable[index] = (
            not obstructed and offset <= reached + TOLERANCE_M and not simulator.meets_housing(pose)
        )
    return touches


def _gel_contact(gap: np.ndarray, sensor: Sensor, depth: float | None, force: float) -> Contact:
    """Contact of the gel with an object `gap` (rows, columns) metres over it."""
    pitch = sensor.gel_height_m / gap.shape[0], sensor.gel_width_m / gap.shape[1]
    gel = gel_elastomer(sensor)
    if depth is not None:
        return solve_contact(gap, pitch, gel, indentation_m=depth)
    contact = solve_contact(gap, pitch, gel, force_n=force)
    limit = greatest_depth_m(sensor)
    if contact.indentation_m <= limit:
        return contact
    return solve_contact(gap, pitch, gel, indentation_m=limit, initial_pressure_pa=contact.pressure_pa)


def _advanced(pose: np.ndarray, distance: float) -> np.ndarray:
    """Pose (4, 4) of the sensor after it has moved along its axis."""
    moved = pose.copy()
    moved[:3, 3] += distance * pose[:3, 0]
    return moved
