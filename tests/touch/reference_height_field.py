"""Heights over the gel by array arithmetic: the oracle of the compiled kernel."""

from itertools import pairwise

import numpy as np
from reference_contact import corners_in, in_box

from objectfolder.touch.contact.height_field import FACE_TOLERANCE, REACH_M, gel_grid
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor

PAIRS_AT_ONCE = 1 << 20


def gap_field(
    patches: FacePatches, sensor: Sensor, pose: np.ndarray, grid_shape: tuple[int, int]
) -> np.ndarray:
    """As `objectfolder.touch.contact.height_field.gap_field`."""
    z, y = gel_grid(sensor, grid_shape)
    apex = np.asarray(sensor.gel_apex_m)
    half = np.array([0.0, sensor.gel_width_m / 2, sensor.gel_height_m / 2])
    low, high = apex - half, apex + half
    low[0], high[0] = sensor.camera_position_m[0] + sensor.near_m, apex[0] + REACH_M
    x = lowest(corners_in(patches, pose, in_box(patches, pose, low, high)), y, z, float(low[0]))
    x[x > high[0]] = np.inf
    yy, zz = np.meshgrid(y, z)
    return np.asarray(x - gel_surface(sensor, yy, zz))


def lowest(triangles: np.ndarray, y: np.ndarray, z: np.ndarray, least: float) -> np.ndarray:
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
    inside = (area != 0) & (
        np.minimum.reduce([weight * sign for weight in weights]) >= -FACE_TOLERANCE * size
    )
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
