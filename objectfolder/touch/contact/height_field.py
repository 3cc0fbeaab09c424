"""The object's lowest surface over the gel, on a regular grid in the sensor's frame.

What a contact solver needs of the object: parallel rays along the sensor's axis, one a cell.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import kernel
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.sensor.gel import gel_constants, gel_surface
from objectfolder.touch.sensor.sensor import Sensor

# How far outside a face, in parts of its doubled area, a ray still meets it: none slips between two faces.
FACE_TOLERANCE = 1e-12
# Faces further than this above the gel's apex do not count.
REACH_M = 0.01


def gel_grid(sensor: Sensor, grid_shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates z (rows,) and y (columns,) of the centres of the gel's cells, sensor frame, metres.

    Both descend, as in the sensor's images: the first row is at the gel's top, the first column at its left.
    """
    rows, columns = grid_shape
    z = sensor.gel_apex_m[2] + (0.5 - (np.arange(rows) + 0.5) / rows) * sensor.gel_height_m
    y = sensor.gel_apex_m[1] + (0.5 - (np.arange(columns) + 0.5) / columns) * sensor.gel_width_m
    return z, y


def gap_field(
    patches: FacePatches, sensor: Sensor, pose: np.ndarray, grid_shape: tuple[int, int]
) -> np.ndarray:
    """Height of the object's lowest surface over the undeformed gel, along the sensor's axis.

    Parameters
    ----------
    pose
        sensor_to_object (4, 4), metres.
    grid_shape
        Rows and columns, at least 2 each, of cells over the gel's extent; `gel_grid` gives their centres.

    Returns
    -------
    np.ndarray
        (rows, columns) float64 metres, negative where the object lies in the gel, infinity where no face
        lies between the camera's near plane and `REACH_M` above the gel's apex.
    """
    z, y = gel_grid(sensor, grid_shape)
    gel = gel_constants(sensor)
    _, triangles, _ = patches.near_gel(pose, gel, -REACH_M - sensor.gel_sagitta_m)
    x = _lowest(triangles, y, z, sensor.camera_position_m[0] + sensor.near_m)
    x[x > sensor.gel_apex_m[0] + REACH_M] = np.inf
    yy, zz = np.meshgrid(y, z)
    return np.asarray(x - gel_surface(sensor, yy, zz))


@kernel
def _covered(a, b, c, first, pitch, count):
    """First and last cell whose centre lies between the least and greatest of three coordinates."""
    a, b, c = (a - first) / pitch, (b - first) / pitch, (c - first) / pitch
    least, most = min(min(a, b), c) - 1e-9, max(max(a, b), c) + 1e-9
    return int(np.ceil(min(max(least, 0.0), count))), int(np.floor(max(min(most, count - 1.0), -1.0)))


@kernel
def _lowest(triangles, y, z, least):
    """Least x >= `least` (rows, columns) of triangles (m, 3, 3) over the grid; infinity where there is none.

    `triangles` are in the sensor frame, metres; `y` (columns,) and `z` (rows,) descend.
    """
    heights = np.full((len(z), len(y)), np.inf)
    for face in range(len(triangles)):
        a, b, c = triangles[face, 0], triangles[face, 1], triangles[face, 2]
        low, high = min(min(a[0], b[0]), c[0]), max(max(a[0], b[0]), c[0])
        if high < least:
            continue
        first_row, last_row = _covered(a[2], b[2], c[2], z[0], z[1] - z[0], len(z))
        first_column, last_column = _covered(a[1], b[1], c[1], y[0], y[1] - y[0], len(y))
        for row in range(first_row, last_row + 1):
            az, bz, cz = a[2] - z[row], b[2] - z[row], c[2] - z[row]
            for column in range(first_column, last_column + 1):
                ay, by, cy = a[1] - y[column], b[1] - y[column], c[1] - y[column]
                first, second, third = by * cz - bz * cy, cy * az - cz * ay, ay * bz - az * by
                area = first + second + third
                if area == 0:
                    continue
                sign = 1.0 if area > 0 else -1.0
                slack = -FACE_TOLERANCE * (abs(first) + abs(second) + abs(third))
                if first * sign < slack or second * sign < slack or third * sign < slack:
                    continue
                x = (first * a[0] + second * b[0] + third * c[0]) / area
                x = min(max(x, low), high)
                if x >= least and x < heights[row, column]:
                    heights[row, column] = x
    return heights
