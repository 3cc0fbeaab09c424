"""A photometric table of a real sensor from images of a ball pressed into its gel.

The calibration of GelSight sensors (Yuan, Dong & Adelson 2017, Sensors 17(12); Si & Yuan 2022, RA-L 7(2)):
in the contact the membrane has the slopes of a known sphere. Needs SciPy.
"""

from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.renaming import formerly_positional
from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.photometric_table import (
    CHANNELS,
    TERMS,
    PhotometricTable,
    node_weights,
    place_terms,
)
from objectfolder.touch.sensor.sensor import Sensor

# Of the contact's radius: near its rim the gel no longer follows the ball.
TRUSTED = 0.9


@formerly_positional
def fit_table(
    sensor: Sensor,
    images: np.ndarray,
    *,
    centres_m: np.ndarray,
    depths_m: np.ndarray,
    radius_m: float,
    untouched: np.ndarray,
    shape: tuple[int, int] = (13, 24),
    smoothness: float = 1e-4,
) -> PhotometricTable:
    """Fit a table to images of a ball, by least squares.

    Neighbouring nodes are held together by their second differences, so that slopes which no ball showed
    follow from those that it did.

    Parameters
    ----------
    sensor
        Its camera and gel; flat. A table that it has counts for nothing.
    images
        (n, height, width, 3) uint8, of the sensor's image size.
    centres_m
        (n, 2): y and z of the ball's centre in the sensor frame.
    depths_m
        (n,): how deep its lowest point lies in the gel.
    radius_m
        Of the ball.
    untouched
        (height, width, 3) uint8, what the camera sees when nothing touches it.
    shape
        Slopes and directions of the table.
    smoothness
        Weight of the mean squared second difference beside the mean squared error of the pixels.

    Raises
    ------
    InputError
        Arrays of other shapes, a curved gel, or no contact in any image.

    Examples
    --------
    >>> import numpy as np
    >>> from objectfolder.touch import read_sensor
    >>> gelsight = read_sensor("gelsight")
    >>> grey = np.full((gelsight.image_height, gelsight.image_width, 3), 128, np.uint8)
    >>> ball = {"centres_m": np.zeros((1, 2)), "depths_m": np.array([0.001]), "radius_m": 0.004}
    >>> table = fit_table(gelsight, grey[None], **ball, untouched=grey)
    >>> table.coefficients[:, 0, 0, 0].round(2).tolist()  # as grey when flat
    [0.5, 0.5, 0.5]
    """
    _check(sensor, images, centres_m, depths_m, untouched)
    grid = ray_grid(sensor, 1)
    u, v = (part.ravel() for part in np.meshgrid(grid.u, grid.v))
    rays = np.stack([np.ones_like(u), u, v])
    flat = np.zeros_like(rays)
    flat[0] = -1.0
    seen = [_seen(sensor, grid.gel_depth * rays, flat, untouched, grid.gel_depth > 0)]
    for image, centre, depth in zip(images, centres_m, depths_m, strict=True):
        position, normal, trusted = _ball(sensor, rays, centre, float(depth), radius_m)
        if trusted.any():
            seen.append(_seen(sensor, position, normal, image, trusted))
    if len(seen) == 1:
        remedy = "Check centres_m, depths_m and radius_m."
        raise InputError("images", "the ball touches the gel in none", remedy)
    return PhotometricTable(_least_squares(np.concatenate(seen, axis=1), shape, smoothness))


def _check(
    sensor: Sensor, images: np.ndarray, centres_m: np.ndarray, depths_m: np.ndarray, untouched: np.ndarray
) -> None:
    size = (sensor.image_height, sensor.image_width, 3)
    if sensor.gel_sagitta_m != 0:
        raise InputError(sensor.name, "its gel is curved", "A table is for a flat gel.")
    if images.ndim != 4 or images.shape[1:] != size or untouched.shape != size:
        found = f"shapes {images.shape} and {untouched.shape}"
        raise InputError("images", found, f"Give (n, {size[0]}, {size[1]}, 3) and one of them untouched.")
    if centres_m.shape != (len(images), 2) or depths_m.shape != (len(images),):
        raise InputError("centres_m, depths_m", "not one for each image", "Give (n, 2) and (n,).")


def _least_squares(seen: np.ndarray, shape: tuple[int, int], smoothness: float) -> np.ndarray:
    """Coefficients (3, slopes, directions, 6) float16 of what `_seen` returned (7, m)."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import spsolve

    slope, direction, across, up = seen[:4]
    nodes, weights = node_weights(slope, direction, shape)
    unknown = _unknowns(shape)
    column = unknown[nodes][:, :, None] * TERMS + np.arange(TERMS)
    row = np.broadcast_to(np.arange(len(slope))[None, :, None], column.shape)
    entry = weights[:, :, None] * place_terms(across, up)
    count = int(unknown.max() + 1) * TERMS
    design = coo_array((entry.ravel(), (row.ravel(), column.ravel())), (len(slope), count)).tocsr()
    bending = _second_differences(shape, unknown, count).tocsr()
    normal_matrix = design.T @ design / len(slope) + smoothness / bending.shape[0] * (bending.T @ bending)
    right = design.T @ seen[4:].T / len(slope)
    solution = spsolve(normal_matrix.tocsc(), right).reshape(-1, TERMS, CHANNELS)
    return np.moveaxis(solution[unknown.reshape(shape)], 3, 0).astype(np.float16)


def _ball(
    sensor: Sensor, rays: np.ndarray, centre: np.ndarray, depth: float, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where rays (3, n) meet a ball, from the camera; its normals there; and which meet it in the gel."""
    camera = np.asarray(sensor.camera_position_m)
    middle = np.array([sensor.gel_apex_m[0] - depth + radius, *centre]) - camera
    along = middle @ rays
    squared = np.einsum("ij,ij->j", rays, rays)
    root = along**2 - squared * (middle @ middle - radius**2)
    position = (along - np.sqrt(np.maximum(root, 0.0))) / squared * rays
    normal = position - middle[:, None]
    contact = np.sqrt(max(2 * radius * depth - depth**2, 0.0)) * TRUSTED
    trusted = (root > 0) & (np.hypot(normal[1], normal[2]) < contact)
    return position, normal, trusted


def _seen(
    sensor: Sensor, position: np.ndarray, normal: np.ndarray, image: np.ndarray, kept: np.ndarray
) -> np.ndarray:
    """Slope, direction, place across and up, and pixel values (7, m) of the pixels kept."""
    camera, apex = np.asarray(sensor.camera_position_m), np.asarray(sensor.gel_apex_m)
    place = position + (camera - apex)[:, None]
    return np.stack(
        [
            np.arctan2(np.hypot(normal[1], normal[2]), -normal[0]),
            np.arctan2(normal[2], -normal[1]),
            -place[1] / (sensor.gel_width_m / 2),
            place[2] / (sensor.gel_height_m / 2),
            *(image.reshape(-1, CHANNELS).T / 255),
        ]
    )[:, kept]


def _unknowns(shape: tuple[int, int]) -> np.ndarray:
    """Number of the unknown of each node (slopes * directions,): one for all directions at slope 0."""
    slopes, directions = shape
    return np.maximum(np.arange(slopes * directions) - directions + 1, 0)


def _second_differences(shape: tuple[int, int], unknown: np.ndarray, count: int) -> Any:
    """Sparse matrix of the second differences of each coefficient over slopes and directions."""
    from scipy.sparse import coo_array

    number = unknown.reshape(shape)
    triples = [np.stack([number[:-2], number[1:-1], number[2:]], axis=-1).reshape(-1, 3)]
    triples.append(
        np.stack([np.roll(number, 1, axis=1), number, np.roll(number, -1, axis=1)], axis=-1)[1:].reshape(
            -1, 3
        )
    )
    each = np.concatenate(triples)
    column = (each[:, None, :] * TERMS + np.arange(TERMS)[None, :, None]).reshape(-1, 3)
    row = np.broadcast_to(np.arange(len(column))[:, None], column.shape)
    entry = np.broadcast_to(np.array([1.0, -2.0, 1.0]), column.shape)
    return coo_array((entry.ravel(), (row.ravel(), column.ravel())), (len(column), count))
