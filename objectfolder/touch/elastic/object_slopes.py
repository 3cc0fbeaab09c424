"""How the object leans where it touches the gel, by its smooth normals: facets of a mesh do not show."""

import numpy as np

from objectfolder.touch.contact.height_field import gel_grid
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.elastic.contact_problem import Contact
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor

# Walls steeper than this keep the slope of the displacement, which cells can show.
STEEPEST_WALL = 2.0


def object_slopes(
    patches: FacePatches, sensor: Sensor, pose: np.ndarray, gap_m: np.ndarray, contact: Contact
) -> np.ndarray:
    """Slopes of the object over the cells of gel that it touches.

    Parameters
    ----------
    pose
        sensor_to_object (4, 4) at which the height over the undeformed gel is `gap_m`.
    gap_m
        (rows, columns) of `height_field.gap_field`.
    contact
        Which cells are touched.

    Returns
    -------
    np.ndarray
        (2, rows, columns) float64: dx/dy and dx/dz in the sensor frame; NaN where the gel is not touched, and
        where the object is steeper than `STEEPEST_WALL`.
    """
    row, column = np.nonzero(contact.mask)
    slopes = np.full((2, *gap_m.shape), np.nan)
    z, y = gel_grid(sensor, (gap_m.shape[0], gap_m.shape[1]))
    y, z = y[column], z[row]
    local = np.stack([gel_surface(sensor, y, z) + gap_m[row, column], y, z], axis=1)
    points = local @ pose[:3, :3].T + pose[:3, 3]
    face, barycentric = patches.closest(points)
    normals = patches.surface.normals_at(face, barycentric) @ pose[:3, :3]
    # The side that is touched faces the camera, whichever way the shell is turned.
    towards = np.abs(normals[:, 0])
    outward = np.sign(-normals[:, :1])
    with np.errstate(divide="ignore", invalid="ignore"):
        lean = normals[:, 1:] * outward / towards[:, None]
    lean[~(np.hypot(lean[:, 0], lean[:, 1]) < STEEPEST_WALL)] = np.nan
    slopes[:, row, column] = lean.T
    return slopes
