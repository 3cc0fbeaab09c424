"""Where rays meet the deformed gel, by array arithmetic: the oracle of the compiled kernel."""

import numpy as np

from objectfolder.touch.elastic.membrane import LEAST_APPROACH, NEWTON_STEPS, UNMOVED_M, UNMOVED_SLOPE
from objectfolder.touch.sensor.camera import RayGrid
from objectfolder.touch.sensor.gel import gel_slopes, gel_surface
from objectfolder.touch.sensor.sensor import Sensor


def trace_membrane(fields: np.ndarray, sensor: Sensor, grid: RayGrid) -> tuple[np.ndarray, ...]:
    """Meet the membrane by Newton's method along each ray, from the undeformed gel on."""
    fields = np.moveaxis(fields, -1, 0)
    v, u = (part.ravel() for part in np.meshgrid(grid.v, grid.u, indexing="ij"))
    displacement, down_y, down_z, _ = _bilinear(fields, sensor, *_along(sensor, grid.gel_depth, u, v))
    moved = np.abs(displacement) > UNMOVED_M
    moved |= np.abs(down_y) + np.abs(down_z) > UNMOVED_SLOPE
    sample = np.flatnonzero(moved)
    u, v, ray = u[sample], v[sample], grid.gel_depth[sample]
    for _ in range(NEWTON_STEPS):
        y, z = _along(sensor, ray, u, v)
        displacement, down_y, down_z = _bilinear_slopes(fields[0], sensor, y, z)
        slope_y, slope_z = gel_slopes(sensor, y, z)
        before = sensor.camera_position_m[0] + ray - gel_surface(sensor, y, z) + displacement
        approach = 1 - (slope_y - down_y) * u - (slope_z - down_z) * v
        ray = np.maximum(ray - before / np.maximum(approach, LEAST_APPROACH), grid.near)
    y, z = _along(sensor, ray, u, v)
    displacement, down_y, down_z, touched = _bilinear(fields, sensor, y, z)
    slope_y, slope_z = gel_slopes(sensor, y, z)
    return (
        sample,
        np.stack([sensor.camera_position_m[0] + ray, y, z]).astype(np.float32),
        np.stack([-np.ones_like(y), slope_y - down_y, slope_z - down_z]).astype(np.float32),
        displacement,
        touched >= 0.5,
    )


def _along(sensor: Sensor, ray: np.ndarray, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates y and z of points of the rays."""
    return sensor.camera_position_m[1] + ray * u, sensor.camera_position_m[2] + ray * v


def _cell(
    shape: tuple[int, ...], sensor: Sensor, y: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First of the four centres round each place (n,), and how far down and right of it the place is.

    Beyond the outermost centres the place counts as on them.
    """
    rows, columns = shape
    row = (0.5 - (z - sensor.gel_apex_m[2]) / sensor.gel_height_m) * rows - 0.5
    column = (0.5 - (y - sensor.gel_apex_m[1]) / sensor.gel_width_m) * columns - 0.5
    row, column = np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)
    top = np.minimum(row.astype(np.int64), rows - 2)
    left = np.minimum(column.astype(np.int64), columns - 2)
    return top * columns + left, row - top, column - left


def _bilinear(fields: np.ndarray, sensor: Sensor, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Fields (k, rows, columns) at places (n,): (k, n)."""
    columns = fields.shape[2]
    index, down, right = _cell(fields.shape[1:], sensor, y, z)
    flat = fields.reshape(len(fields), -1)
    upper = (1 - right) * flat[:, index] + right * flat[:, index + 1]
    lower = (1 - right) * flat[:, index + columns] + right * flat[:, index + columns + 1]
    return np.asarray((1 - down) * upper + down * lower)


def _bilinear_slopes(
    field: np.ndarray, sensor: Sensor, y: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Field (rows, columns) at places (n,), and the slopes along y and z of its interpolation there."""
    rows, columns = field.shape
    index, down, right = _cell(field.shape, sensor, y, z)
    flat = field.ravel()
    a, b, c, d = flat[index], flat[index + 1], flat[index + columns], flat[index + columns + 1]
    upper, lower = a + right * (b - a), c + right * (d - c)
    slope_y = (a - b + down * (c - d - a + b)) * (columns / sensor.gel_width_m)
    slope_z = (upper - lower) * (rows / sensor.gel_height_m)
    return upper + down * (lower - upper), slope_y, slope_z
