"""The deformed gel as a height field, and where the camera's rays meet it.

The surface is the undeformed gel less its displacement, bilinear between the centres of the cells; its slopes
are those of the object where it touches, and central differences elsewhere.
"""

from dataclasses import dataclass

import numpy as np

from objectfolder.touch.contact.height_field import gel_grid
from objectfolder.touch.elastic.contact_problem import Contact
from objectfolder.touch.sensor.camera import RayGrid
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor

# Displacements and slopes below which a ray shows the undeformed gel: less than 0.05 grey levels.
UNMOVED_M = 1e-7
UNMOVED_SLOPE = 1e-4
NEWTON_STEPS = 4
# Of the distance between ray and membrane per metre along the ray; keeps steps finite where they graze.
LEAST_APPROACH = 0.3


@dataclass(frozen=True, eq=False)
class Membrane:
    """Gel deformed by a contact.

    Parameters
    ----------
    fields
        (4, rows, columns) float64: displacement towards the camera, metres, its slopes along the sensor's y
        and z, and 1 where the gel is touched; rows descend in z and columns in y.
    """

    fields: np.ndarray

    @classmethod
    def of(cls, contact: Contact, sensor: Sensor, object_slopes: np.ndarray | None = None) -> "Membrane":
        """Membrane of a contact whose grid is `height_field.gel_grid` of the sensor.

        `object_slopes` (2, rows, columns) are dx/dy and dx/dz of the object where it touches, NaN where they
        are not known.
        """
        displacement = contact.displacement_m
        down_z, down_y = np.gradient(displacement, *contact.pitch_m)
        fields = np.stack([displacement, -down_y, -down_z, contact.mask.astype(np.float64)])
        if object_slopes is not None:
            z, y = gel_grid(sensor, (displacement.shape[0], displacement.shape[1]))
            known = contact.mask & np.isfinite(object_slopes).all(axis=0)
            row, column = np.nonzero(known)
            gel = gel_slopes(sensor, y[column], z[row])
            fields[1:3, row, column] = np.stack(gel) - object_slopes[:, row, column]
        return cls(fields)


@dataclass(frozen=True, eq=False)
class Seen:
    """What rays meet of a membrane that has moved.

    ``sample`` (n,) indices of rays; ``position`` and ``normal`` (3, n) float32, sensor frame, the normal
    towards the camera and not unit; ``displacement`` (n,) metres; ``touched`` (n,) bool.
    """

    sample: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    displacement: np.ndarray
    touched: np.ndarray


def trace_membrane(membrane: Membrane, sensor: Sensor, grid: RayGrid) -> Seen:
    """Meet the membrane by Newton's method along each ray, from the undeformed gel on."""
    fields = membrane.fields
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
    return Seen(
        sample,
        np.stack([sensor.camera_position_m[0] + ray, y, z]).astype(np.float32),
        np.stack([-np.ones_like(y), slope_y - down_y, slope_z - down_z]).astype(np.float32),
        displacement,
        touched >= 0.5,
    )


def gel_slopes(sensor: Sensor, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes dx/dy and dx/dz of the undeformed gel."""
    y, z = y - sensor.gel_apex_m[1], z - sensor.gel_apex_m[2]
    scale = -sensor.gel_stretch / np.sqrt(sensor.gel_radius_m**2 - y * y - z * z)
    return scale * y, scale * z


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
