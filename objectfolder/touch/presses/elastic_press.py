"""Press an elastic gel against a surface: to a depth or with a force, and see how the gel deforms."""

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.touch.contact.height_field import gap_field
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.elastic.contact_problem import Contact, solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.membrane import membrane_fields, membrane_image
from objectfolder.touch.elastic.object_slopes import object_slopes
from objectfolder.touch.presses.touches import TOLERANCE_M, Press, Touches, saturation_depth_m
from objectfolder.touch.rendering.simulator import Simulator
from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.sensor import Sensor


def greatest_depth_m(sensor: Sensor) -> float:
    """Depth at which an elastic gel is saturated, metres: the sensor's own, or that of the backing."""
    return min(saturation_depth_m(sensor), sensor.gel_thickness_m)


def press_elastic(
    simulator: Simulator,
    patches: FacePatches,
    sensor: Sensor,
    query: Press,
    poses: np.ndarray,
    touches: Touches,
) -> None:
    """Press the sensor's gel, an elastic layer bonded to its backing, from poses of first touch.

    The curved gel is taken as a flat layer whose distance to the object is the difference of their heights,
    as Hertz did, and friction as none; elasticity is linear. The pressure follows by `solve_contact`, and the
    image shows the deformed gel: it follows the object where they touch, and bends away round it.

    Parameters
    ----------
    simulator
        Of the surface, the sensor and the samples asked for.
    poses
        (n, 4, 4) of first touch.
    touches
        n, filled in, but for points and normals: as of `press.press`, but ``depth`` is how far the gel that a
        pixel sees is displaced along the sensor's axis, in contact or not, negative where it bulges out;
        ``mask`` is where the gel is touched; ``contact_area_m2`` is the area of gel in contact;
        ``penetration_m`` is how far the object lies in the undeformed gel; ``force_n`` is what the gel bears,
        less than asked for where it is saturated before.

    Raises
    ------
    QueryError
        A depth or force out of range, both of them, cells that are not positive.
    SimulationError
        A contact that is not found, see `solve_contact`.
    """
    shape = _cells(sensor, query.cell_m)
    forces = query.forces(len(poses))
    depths = query.depths(len(poses), greatest_depth_m(sensor)) if forces is None else None
    grid = ray_grid(sensor, query.samples)
    for index, first_touch in enumerate(poses):
        # Another part of the object may meet the gel before the asked point does.
        offset = simulator.approach(first_touch, 0.0).greatest
        start = _advanced(first_touch, -offset)
        obstructed = simulator.approach(start, 0.0).greatest > TOLERANCE_M
        gap = np.full(shape, np.inf) if obstructed else gap_field(patches, sensor, start, shape)
        depth = None if depths is None else float(depths[index])
        force = 0.0 if forces is None else float(forces[index])
        contact = _gel_contact(gap, sensor, 0.0 if obstructed else depth, force)
        reached = contact.indentation_m
        pose = _advanced(start, reached if depth is None else depth)
        fields = membrane_fields(contact, sensor, object_slopes(patches, sensor, start, gap, contact))
        touches.rgb[index], touches.depth_m[index], touches.mask[index] = membrane_image(fields, sensor, grid)
        touches.sensor_to_object[index] = pose
        touches.first_contact_offset_m[index] = offset
        touches.penetration_m[index] = reached
        touches.contact_area_m2[index] = contact.contact_area_m2
        touches.force_n[index] = contact.force_n
        touches.saturated[index] = reached >= greatest_depth_m(sensor) - TOLERANCE_M
        touches.reachable[index] = (
            not obstructed and offset <= reached + TOLERANCE_M and not simulator.meets_housing(pose)
        )


def _cells(sensor: Sensor, cell_m: float) -> tuple[int, int]:
    """Rows and columns of cells of gel of about this size."""
    if not 0 < cell_m <= min(sensor.gel_width_m, sensor.gel_height_m) / 2:
        raise QueryError("cell_m", f"{cell_m}", "It must be positive, and much smaller than the gel.")
    return max(2, round(sensor.gel_height_m / cell_m)), max(2, round(sensor.gel_width_m / cell_m))


def _gel_contact(gap: np.ndarray, sensor: Sensor, depth: float | None, force: float) -> Contact:
    """Contact of the gel with an object `gap` (rows, columns) metres over it."""
    pitch = sensor.gel_height_m / gap.shape[0], sensor.gel_width_m / gap.shape[1]
    gel = Elastomer(sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio, sensor.gel_thickness_m)
    if depth is not None or force == 0:
        return solve_contact(gap, pitch, gel, indentation_m=depth or 0.0)
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
