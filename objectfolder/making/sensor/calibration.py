"""A photometric table of a real sensor from images of a ball pressed into its gel.

The calibration of GelSight sensors (Yuan, Dong & Adelson 2017, Sensors 17(12); Si & Yuan 2022, RA-L 7(2)):
in the contact the membrane has the slopes of a known sphere. Needs SciPy.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.renaming import formerly_positional
from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.gel import gel_normals, gel_surface
from objectfolder.touch.sensor.photometric_table import (
    CHANNELS,
    POLYNOMIAL_TERMS,
    PhotometricTable,
    node_weights,
    place_terms,
)
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import shade

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
        Its camera and gel, flat or curved. A table that it has counts for nothing.
    images
        (n, height, width, 3) uint8, of the sensor's image size.
    centres_m
        (n, 2): y and z of the ball's centre in the sensor frame.
    depths_m
        (n,): how deep its lowest point lies in the gel, along the sensor's axis.
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
        Arrays of other shapes, or no contact in any image.

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
    parts = [gel_pixels(sensor, untouched)]
    for image, centre, depth in zip(images, centres_m, depths_m, strict=True):
        parts.append(ball_pixels(sensor, image, centre, float(depth), radius_m))
    if not any(part.shape[1] for part in parts[1:]):
        remedy = "Check centres_m, depths_m and radius_m."
        raise InputError("images", "the ball touches the gel in none", remedy)
    return normal_equations(np.concatenate(parts, axis=1), shape).solve(smoothness)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """What pixels say of the nodes of a table, to be added up over pictures and solved.

    Parameters
    ----------
    shape
        Slopes and directions of the table.
    matrix, right
        Sparse (m, m) and (m, 3): sums over the pixels.
    count
        How many pixels there are.
    """

    shape: tuple[int, int]
    matrix: Any
    right: np.ndarray
    count: int

    def __add__(self, other: "NormalEquations") -> "NormalEquations":
        summed = self.matrix + other.matrix, self.right + other.right
        return NormalEquations(self.shape, *summed, self.count + other.count)

    def solve(self, smoothness: float, uniformity: float = 0.0, share: float = 1.0) -> PhotometricTable:
        """Return the table of least squared error, held smooth; `smoothness` as of `fit_table`.

        `uniformity` is the weight of the mean squared difference between how a node depends on the place and
        a share of how the untouched gel does. With a share of 1 a slope then changes the gel everywhere
        alike; with 0 it looks everywhere alike.
        """
        from scipy.sparse.linalg import spsolve

        solution = spsolve(self._smoothed(smoothness, uniformity, share), self.right / self.count)
        nodes = solution.reshape(-1, POLYNOMIAL_TERMS, CHANNELS)[_unknowns(self.shape).reshape(self.shape)]
        return PhotometricTable(np.moveaxis(nodes, 3, 0).astype(np.float16))

    def spread(self, smoothness: float, uniformity: float = 0.0, share: float = 1.0) -> np.ndarray:
        """Deviation (slopes, directions) of the values at the gel's middle, for one of a pixel."""
        inverse = np.linalg.inv(self._smoothed(smoothness, uniformity, share).toarray()) / self.count
        constant = np.sqrt(np.maximum(np.diag(inverse)[::POLYNOMIAL_TERMS], 0.0))
        return np.asarray(constant[_unknowns(self.shape)].reshape(self.shape))

    def _smoothed(self, smoothness: float, uniformity: float, share: float) -> Any:
        bending = _second_differences(self.shape, _unknowns(self.shape), self.matrix.shape[0]).tocsr()
        penalty = smoothness / bending.shape[0] * (bending.T @ bending)
        if uniformity:
            uneven = _place_differences(self.matrix.shape[0], share)
            penalty = penalty + uniformity / uneven.shape[0] * (uneven.T @ uneven)
        return (self.matrix / self.count + penalty).tocsc()


def _rays(sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Rays (3, n) of the pixels, 1 along the axis, and depths (n,) of the untouched gel along them."""
    grid = ray_grid(sensor, 1)
    u, v = (part.ravel() for part in np.meshgrid(grid.u, grid.v))
    return np.stack([np.ones_like(u), u, v]), grid.gel_depth


def gel_pixels(sensor: Sensor, untouched: np.ndarray) -> np.ndarray:
    """Return what the pixels of the untouched gel say, as `normal_equations` takes it."""
    rays, depth = _rays(sensor)
    position = depth * rays
    y, z = position[1:] + np.asarray(sensor.camera_position_m)[1:, None]
    return _seen(sensor, position, gel_normals(sensor, y, z), untouched, depth > 0)


def ball_pixels(
    sensor: Sensor,
    image: np.ndarray,
    centre: np.ndarray,
    depth: float,
    radius: float,
    share: float = TRUSTED,
    shown: np.ndarray | None = None,
) -> np.ndarray:
    """Return what the pixels in a share of a ball's contact say; arguments as of `fit_table`, of one.

    Of those `shown` (height, width), if given.
    """
    position, normal, trusted = _ball(sensor, _rays(sensor)[0], centre, depth, radius, share)
    if shown is not None:
        trusted &= shown.ravel()
    return _seen(sensor, position, normal, image, trusted)


def _check(
    sensor: Sensor, images: np.ndarray, centres_m: np.ndarray, depths_m: np.ndarray, untouched: np.ndarray
) -> None:
    size = (sensor.image_height, sensor.image_width, 3)
    if images.ndim != 4 or images.shape[1:] != size or untouched.shape != size:
        shapes = f"shapes {images.shape} and {untouched.shape}"
        raise InputError("images", shapes, f"Give (n, {size[0]}, {size[1]}, 3) and one of them untouched.")
    if centres_m.shape != (len(images), 2) or depths_m.shape != (len(images),):
        raise InputError("centres_m, depths_m", "not one for each image", "Give (n, 2) and (n,).")


def normal_equations(pixels: np.ndarray, shape: tuple[int, int]) -> NormalEquations:
    """Return what pixels (7, n) say of a table: slope, direction, place across and up, and three colours."""
    from scipy.sparse import coo_array

    slope, direction, across, up = pixels[:4]
    nodes, weights = node_weights(slope, direction, shape)
    unknown = _unknowns(shape)
    column = unknown[nodes][:, :, None] * POLYNOMIAL_TERMS + np.arange(POLYNOMIAL_TERMS)
    row = np.broadcast_to(np.arange(len(slope))[None, :, None], column.shape)
    entry = weights[:, :, None] * place_terms(across, up)
    count = int(unknown.max() + 1) * POLYNOMIAL_TERMS
    design = coo_array((entry.ravel(), (row.ravel(), column.ravel())), (len(slope), count)).tocsr()
    return NormalEquations(shape, design.T @ design, design.T @ pixels[4:].T, len(slope))


def _ball(
    sensor: Sensor, rays: np.ndarray, centre: np.ndarray, depth: float, radius: float, share: float = TRUSTED
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where rays (3, n) meet a ball, from the camera; its normals; which are in a share of the contact."""
    camera = np.asarray(sensor.camera_position_m)
    lowest = float(gel_surface(sensor, centre[0], centre[1])) - depth
    middle = np.array([lowest + radius, *centre]) - camera
    along = middle @ rays
    squared = np.einsum("ij,ij->j", rays, rays)
    root = along**2 - squared * (middle @ middle - radius**2)
    position = (along - np.sqrt(np.maximum(root, 0.0))) / squared * rays
    normal = position - middle[:, None]
    y, z = position[1:] + camera[1:, None]
    indentation = gel_surface(sensor, y, z) - camera[0] - position[0]
    return position, normal, (root > 0) & (depth > 0) & (indentation > (1 - share**2) * depth)


def ball_indentation(sensor: Sensor, centre: np.ndarray, depth: float, radius: float) -> np.ndarray:
    """How far a ball presses the gel in (height, width), metres; arguments as of `fit_table`, of one."""
    position, _, touched = _ball(sensor, _rays(sensor)[0], centre, depth, radius, 1.0)
    camera = np.asarray(sensor.camera_position_m)
    y, z = position[1:] + camera[1:, None]
    indentation = np.where(touched, gel_surface(sensor, y, z) - camera[0] - position[0], 0.0)
    return np.asarray(indentation.reshape(sensor.image_height, sensor.image_width))


def ball_image(sensor: Sensor, centre: np.ndarray, depth: float, radius: float) -> np.ndarray:
    """What a sensor shows of a ball (height, width, 3), grey levels; arguments as of `fit_table`, of one."""
    position, normal, touched = _ball(sensor, _rays(sensor)[0], centre, depth, radius, 1.0)
    values = ray_grid(sensor, 1).gel_values.copy()
    place = position + np.asarray(sensor.camera_position_m)[:, None]
    values[touched] = shade(sensor, place[:, touched], normal[:, touched])
    return np.asarray(values.reshape(sensor.image_height, sensor.image_width, CHANNELS) * 255.0)


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
    column = (each[:, None, :] * POLYNOMIAL_TERMS + np.arange(POLYNOMIAL_TERMS)[None, :, None]).reshape(-1, 3)
    row = np.broadcast_to(np.arange(len(column))[:, None], column.shape)
    entry = np.broadcast_to(np.array([1.0, -2.0, 1.0]), column.shape)
    return coo_array((entry.ravel(), (row.ravel(), column.ravel())), (len(column), count))


def _place_differences(count: int, share: float) -> Any:
    """Sparse matrix of each coefficient of the place less a share of the untouched gel's."""
    from scipy.sparse import coo_array

    unknown = np.arange(count)
    chosen = unknown[(unknown >= POLYNOMIAL_TERMS) & (unknown % POLYNOMIAL_TERMS > 0)]
    row, ones = np.arange(len(chosen)), np.ones(len(chosen))
    entry, column = np.concatenate([ones, -share * ones]), np.concatenate([chosen, chosen % POLYNOMIAL_TERMS])
    return coo_array((entry, (np.tile(row, 2), column)), (len(chosen), count)).tocsr()
