"""Where rays meet the deformed gel, by halving intervals: the oracle of the compiled kernel."""

import numpy as np
from scipy.ndimage import map_coordinates

from objectfolder.touch.sensor.camera import RayGrid
from objectfolder.touch.sensor.gel import gel_slopes, gel_surface
from objectfolder.touch.sensor.sensor import Sensor

# How far before and behind the undeformed gel the membrane is looked for.
BEFORE_M, BEHIND_M, HALVINGS = 0.004, 0.001, 40


def trace_membrane(fields: np.ndarray, sensor: Sensor, grid: RayGrid) -> tuple[np.ndarray, ...]:
    """Meet the membrane along all rays, as `objectfolder.touch.elastic.membrane._trace` answers."""
    rows, columns, _ = fields.shape
    v, u = (part.ravel() for part in np.meshgrid(grid.v, grid.u, indexing="ij"))

    def at(ray: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates y and z on the rays, and the four fields there."""
        y, z = sensor.camera_position_m[1] + ray * u, sensor.camera_position_m[2] + ray * v
        row = (0.5 - (z - sensor.gel_apex_m[2]) / sensor.gel_height_m) * rows - 0.5
        column = (0.5 - (y - sensor.gel_apex_m[1]) / sensor.gel_width_m) * columns - 0.5
        place = [row, column]
        return (
            y,
            z,
            np.stack([map_coordinates(fields[..., k], place, order=1, mode="nearest") for k in range(4)]),
        )

    low, high = grid.gel_depth - BEFORE_M, grid.gel_depth + BEHIND_M
    for _ in range(HALVINGS):
        ray = (low + high) / 2
        y, z, values = at(ray)
        beyond = sensor.camera_position_m[0] + ray > gel_surface(sensor, y, z) - values[0]
        low, high = np.where(beyond, low, ray), np.where(beyond, ray, high)
    y, z, (displacement, down_y, down_z, touched) = at(low)
    slope_y, slope_z = gel_slopes(sensor, y, z)
    return (
        np.arange(len(low)),
        np.stack([sensor.camera_position_m[0] + low, y, z]).astype(np.float32),
        np.stack([-np.ones_like(y), slope_y - down_y, slope_z - down_z]).astype(np.float32),
        displacement,
        touched >= 0.5,
    )
