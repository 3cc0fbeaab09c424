"""The deformed gel as a height field, where the camera's rays meet it, and what the camera sees.

The surface is the undeformed gel less its displacement, bilinear between the centres of the cells; its slopes
are those of the object where it touches, and central differences elsewhere.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import inner, kernel
from objectfolder.touch.contact.height_field import gel_grid
from objectfolder.touch.elastic.contact_problem import Contact
from objectfolder.touch.rendering.surroundings import surroundings
from objectfolder.touch.sensor.camera import DEPTH_STEPS_PER_M, RayGrid, resolve, to_bytes
from objectfolder.touch.sensor.gel import gel_slopes
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import shade

# Displacements and slopes below which a ray shows the undeformed gel: less than 0.05 grey levels.
UNMOVED_M = 1e-7
UNMOVED_SLOPE = 1e-4
NEWTON_STEPS = 4
# Of the distance between ray and membrane per metre along the ray; keeps steps finite where they graze.
LEAST_APPROACH = 0.3


def membrane_fields(contact: Contact, sensor: Sensor, object_slopes: np.ndarray) -> np.ndarray:
    """Displacement, slopes and touch of a gel on the grid of a contact, `height_field.gel_grid`.

    Parameters
    ----------
    object_slopes
        (2, rows, columns) dx/dy and dx/dz of the object where it touches, NaN where they are not known.

    Returns
    -------
    np.ndarray
        (rows, columns, 4) float64: displacement towards the camera, metres, its slopes along the sensor's y
        and z, and 1 where the gel is touched; rows descend in z and columns in y.
    """
    displacement = contact.displacement_m
    down_z, down_y = np.gradient(displacement, *contact.pitch_m)
    fields = np.stack([displacement, -down_y, -down_z, contact.mask.astype(np.float64)], axis=-1)
    z, y = gel_grid(sensor, (displacement.shape[0], displacement.shape[1]))
    row, column = np.nonzero(contact.mask & np.isfinite(object_slopes).all(axis=0))
    gel = np.stack(gel_slopes(sensor, y[column], z[row]), axis=-1)
    fields[row, column, 1:3] = gel - object_slopes[:, row, column].T
    return fields


def membrane_image(
    fields: np.ndarray, sensor: Sensor, grid: RayGrid
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Image of the deformed gel by the sensor's own shading.

    Parameters
    ----------
    fields
        (rows, columns, 4) of `membrane_fields`.
    grid
        The camera's rays, one or more a pixel.

    Returns
    -------
    tuple
        rgb (height, width, 3) uint8; depth (height, width) float32 metres, the displacement of the membrane
        where a pixel sees it, negative where it bulges out, in steps as the rigid depth maps have; mask
        (height, width) bool, whether at least half of a pixel's samples see the gel touched.
    """
    extent = (sensor.gel_width_m, sensor.gel_height_m, sensor.gel_radius_m, sensor.gel_stretch)
    gel = np.array([*sensor.camera_position_m, *sensor.gel_apex_m, *extent])
    sample, position, normal, displacement, met = _trace(
        fields, gel, grid.u, grid.v, grid.gel_depth, grid.near, NEWTON_STEPS
    )
    values = grid.gel_values.copy()
    values[sample] = shade(sensor, position, normal)
    depth, touched = np.zeros(len(values)), np.zeros(len(values), dtype=np.float32)
    depth[sample], touched[sample] = displacement, met
    depth_map = resolve(depth, sensor, grid.samples)
    rgb = to_bytes(resolve(values, sensor, grid.samples))
    depth_map = (np.trunc(depth_map * DEPTH_STEPS_PER_M) / DEPTH_STEPS_PER_M).astype(np.float32)
    mask = resolve(touched, sensor, grid.samples) >= 0.5
    around = surroundings(sensor)
    if around is not None:
        around.cast(rgb, depth_map, mask)
    return rgb, depth_map, mask


@inner(kernel)
def _cell(shape, gel, y, z):
    """Row and column of the first of the four centres round a place, and how far down and right it is.

    Beyond the outermost centres the place counts as on them.
    """
    row = (0.5 - (z - gel[5]) / gel[7]) * shape[0] - 0.5
    column = (0.5 - (y - gel[4]) / gel[6]) * shape[1] - 0.5
    row, column = min(max(row, 0.0), shape[0] - 1.0), min(max(column, 0.0), shape[1] - 1.0)
    top, left = min(int(row), shape[0] - 2), min(int(column), shape[1] - 2)
    return top, left, row - top, column - left


@inner(kernel)
def _bilinear(nodes, gel, y, z, at):
    top, left, down, right = _cell(nodes.shape, gel, y, z)
    for field in range(4):
        upper = (1 - right) * nodes[top, left, field] + right * nodes[top, left + 1, field]
        lower = (1 - right) * nodes[top + 1, left, field] + right * nodes[top + 1, left + 1, field]
        at[field] = (1 - down) * upper + down * lower


@inner(kernel)
def _meet(nodes, gel, across, up, ray, near, newton_steps):
    """Distance along a ray at which it meets the membrane."""
    for _ in range(newton_steps):
        y, z = gel[1] + ray * across, gel[2] + ray * up
        top, left, down, right = _cell(nodes.shape, gel, y, z)
        a, b = nodes[top, left, 0], nodes[top, left + 1, 0]
        c, d = nodes[top + 1, left, 0], nodes[top + 1, left + 1, 0]
        upper, lower = a + right * (b - a), c + right * (d - c)
        down_y = (a - b + down * (c - d - a + b)) * (nodes.shape[1] / gel[6])
        down_z = (upper - lower) * (nodes.shape[0] / gel[7])
        y, z = y - gel[4], z - gel[5]
        root = np.sqrt(gel[8] * gel[8] - (y * y + z * z))
        surface = gel[3] - gel[9] * (gel[8] - root) - (upper + down * (lower - upper))
        slope_y, slope_z = -gel[9] / root * y, -gel[9] / root * z
        approach = 1 - (slope_y - down_y) * across - (slope_z - down_z) * up
        step = (gel[0] + ray - surface) / max(approach, LEAST_APPROACH)
        ray = max(ray - step, near)
        # Newton's next step would be of the order of the square of this one.
        if abs(step) < 1e-8:
            break
    return ray


@kernel
def _trace(nodes, gel, u, v, gel_depth, near, newton_steps):
    """Meet the membrane by Newton's method along each ray, from the undeformed gel on.

    Of the rays for which it has moved: indices (k,), positions and normals (3, k) float32, the normals
    towards the camera and not unit, displacements (k,) metres, and whether (k,) the gel is touched there.
    """
    count = len(u) * len(v)
    sample = np.empty(count, np.int64)
    position, normal = np.empty((3, count), np.float32), np.empty((3, count), np.float32)
    displacement, touched = np.empty(count), np.empty(count, np.bool_)
    at = np.empty(4)
    hits = 0
    for i in range(count):
        across, up = u[i % len(u)], v[i // len(u)]
        ray = gel_depth[i]
        _bilinear(nodes, gel, gel[1] + ray * across, gel[2] + ray * up, at)
        if abs(at[0]) <= UNMOVED_M and abs(at[1]) + abs(at[2]) <= UNMOVED_SLOPE:
            continue
        ray = _meet(nodes, gel, across, up, ray, near, newton_steps)
        y, z = gel[1] + ray * across, gel[2] + ray * up
        _bilinear(nodes, gel, y, z, at)
        b, c = y - gel[4], z - gel[5]
        tilt = -gel[9] / np.sqrt(gel[8] * gel[8] - (b * b + c * c))
        sample[hits] = i
        position[0, hits], position[1, hits], position[2, hits] = gel[0] + ray, y, z
        normal[0, hits], normal[1, hits], normal[2, hits] = -1.0, tilt * b - at[1], tilt * c - at[2]
        displacement[hits] = at[0]
        touched[hits] = at[3] >= 0.5
        hits += 1
    return sample[:hits], position[:, :hits], normal[:, :hits], displacement[:hits], touched[:hits]
