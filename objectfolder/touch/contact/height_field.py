"""The object's lowest surface over the gel, on a regular grid in the sensor's frame.

What a contact solver needs of the object: parallel rays along the sensor's axis, one a cell.
"""

from itertools import pairwise

import numpy as np

from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.rendering.backends import choose_backend
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor

# How far outside a face, in parts of its doubled area, a ray still meets it: none slips between two faces.
TOLERANCE = 1e-12
# Faces further than this above the gel's apex do not count.
REACH_M = 0.01
PAIRS_AT_ONCE = 1 << 20


def gel_grid(sensor: Sensor, grid_shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates z (rows,) and y (columns,) of the centres of the gel's cells, sensor frame, metres.

    Both descend, as in the sensor's images: the first row is at the gel's top, the first column at its left.
    """
    rows, columns = grid_shape
    z = sensor.gel_apex_m[2] + (0.5 - (np.arange(rows) + 0.5) / rows) * sensor.gel_height_m
    y = sensor.gel_apex_m[1] + (0.5 - (np.arange(columns) + 0.5) / columns) * sensor.gel_width_m
    return z, y


def gap_field(
    patches: FacePatches,
    sensor: Sensor,
    pose: np.ndarray,
    grid_shape: tuple[int, int],
    *,
    reach_m: float = REACH_M,
    backend: str | None = None,
) -> np.ndarray:
    """Height of the object's lowest surface over the undeformed gel, along the sensor's axis.

    Parameters
    ----------
    pose
        sensor_to_object (4, 4), metres.
    grid_shape
        Rows and columns, at least 2 each, of cells over the gel's extent; `gel_grid` gives their centres.
    reach_m
        What is further above the gel's apex than this does not count.
    backend
        See `objectfolder.touch.rendering.backends.choose_backend`.

    Returns
    -------
    np.ndarray
        (rows, columns) float64 metres, negative where the object lies in the gel, infinity where no face
        lies between the camera's near plane and the reach.
    """
    z, y = gel_grid(sensor, grid_shape)
    apex = np.asarray(sensor.gel_apex_m)
    half = np.array([0.0, sensor.gel_width_m / 2, sensor.gel_height_m / 2])
    low, high = apex - half, apex + half
    low[0], high[0] = sensor.camera_position_m[0] + sensor.near_m, apex[0] + reach_m
    if choose_backend(backend) == "compiled":
        from objectfolder.touch.compiled.height_field import lowest

        _, triangles = patches.tree.in_box(pose, low, high)
        x = lowest(triangles, y, z, float(low[0]), TOLERANCE)
    else:
        x = _lowest(patches.corners_in(pose, patches.in_box(pose, low, high)), y, z, float(low[0]))
    x[x > high[0]] = np.inf
    yy, zz = np.meshgrid(y, z)
    return np.asarray(x - gel_surface(sensor, yy, zz))


def _lowest(triangles: np.ndarray, y: np.ndarray, z: np.ndarray, least: float) -> np.ndarray:
    """Least x >= `least` (rows, columns) of triangles (m, 3, 3); infinity where there is none."""
    lowest = np.full(len(z) * len(y), np.inf)
    first_row, rows = _covered(triangles[:, :, 2], z)
    first_column, columns = _covered(triangles[:, :, 1], y)
    pairs = rows * columns
    face = np.flatnonzero(pairs)
    for part in _parts(pairs[face]):
        _lower(triangles, face[part], first_row, first_column, columns, pairs, y, z, least, lowest)
    return lowest.reshape(len(z), len(y))


def _covered(coordinate: np.ndarray, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First cell, and number of cells, whose centres lie between the least and greatest of each (m, 3)."""
    pitch = centres[1] - centres[0]
    position = (coordinate - centres[0]) / pitch
    first = np.ceil(position.min(axis=1) - 1e-9).clip(0, len(centres)).astype(np.int64)
    last = np.floor(position.max(axis=1) + 1e-9).clip(-1, len(centres) - 1).astype(np.int64)
    return first, np.maximum(last - first + 1, 0)


def _lower(
    triangles: np.ndarray,
    face: np.ndarray,
    first_row: np.ndarray,
    first_column: np.ndarray,
    columns: np.ndarray,
    pairs: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    least: float,
    lowest: np.ndarray,
) -> None:
    """Lower `lowest` (rows * columns,) to the faces (k,)."""
    count = pairs[face]
    index = np.repeat(face, count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    row = first_row[index] + within // columns[index]
    column = first_column[index] + within % columns[index]
    corners = triangles[index]
    dy, dz = corners[:, :, 1] - y[column, None], corners[:, :, 2] - z[row, None]
    weights = [dy[:, i] * dz[:, j] - dz[:, i] * dy[:, j] for i, j in ((1, 2), (2, 0), (0, 1))]
    area = weights[0] + weights[1] + weights[2]
    size = np.abs(weights[0]) + np.abs(weights[1]) + np.abs(weights[2])
    sign = np.sign(area)
    inside = (area != 0) & (np.minimum.reduce([weight * sign for weight in weights]) >= -TOLERANCE * size)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = sum(weight * corners[:, corner, 0] for corner, weight in enumerate(weights)) / area
    # Within the tolerance of an edge a face seen nearly edge-on may be far outside itself.
    x = np.clip(x, corners[:, :, 0].min(axis=1), corners[:, :, 0].max(axis=1))
    met = inside & (x >= least)
    np.minimum.at(lowest, (row * len(y) + column)[met], x[met])


def _parts(count: np.ndarray) -> list[slice]:
    """Slices with about `PAIRS_AT_ONCE` pairs of face and cell each."""
    chunk = np.cumsum(count) // PAIRS_AT_ONCE
    edges = [0, *(np.flatnonzero(np.diff(chunk)) + 1).tolist(), len(count)]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]
