"""The rays of the sensor's camera, and what it sees of the gel alone."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from objectfolder.touch.sensor.gel import gel_along_rays, gel_normals
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import shade

# Depth maps are multiples of 2^-23 m (0.12 micrometres), exact in float32, so that they compress.
DEPTH_STEPS_PER_M = 2.0**23


@dataclass(frozen=True, eq=False)
class RayGrid:
    """Rays camera + depth (1, u + shift, v) in the sensor's axes, `samples`^2 a pixel.

    ``v`` (rows,) and ``u`` (columns,) descend evenly, ``shift`` (rows,) moves rows; ``gel_depth`` (rows *
    columns,) is the depth of the undeformed gel along the rays, row by row. ``gel_values`` (., 3) float32 are
    the pixel values of the gel: of each ray for `ray_grid`, of each pixel for `coverage_grid`. ``cell`` is
    the area du dv of a ray; ``near`` the near plane, metres.
    """

    samples: int
    u: np.ndarray
    v: np.ndarray
    shift: np.ndarray
    gel_depth: np.ndarray
    gel_values: np.ndarray
    cell: float
    near: float


@lru_cache(maxsize=8)
def ray_grid(sensor: Sensor, samples: int) -> RayGrid:
    """Rays of `sensor` with `samples` x `samples` evenly spaced ones a pixel.

    Raises
    ------
    ValueError
        No sample, or a camera that sees past the gel's borders.
    """
    if samples < 1:
        raise ValueError(f"samples must be at least 1, not {samples}")
    rows, columns = sensor.image_height * samples, sensor.image_width * samples
    extent = 2 * np.tan(np.radians(sensor.field_of_view_deg) / 2)
    pitch = float(extent / rows)
    v = (0.5 - (np.arange(rows) + 0.5) / rows) * extent
    u = (0.5 - (np.arange(columns) + 0.5) / columns) * extent * columns / rows
    vv, uu = (part.ravel() for part in np.meshgrid(v, u, indexing="ij"))
    depth = gel_along_rays(sensor, uu, vv)
    position = np.asarray(sensor.camera_position_m)[:, None] + depth * np.stack([np.ones_like(uu), uu, vv])
    lateral = np.abs(position[1:] - np.asarray(sensor.gel_apex_m)[1:, None]).max(axis=1)
    if not (lateral <= np.array([sensor.gel_width_m, sensor.gel_height_m]) / 2).all():
        raise ValueError(f"{sensor.name}: the camera sees past the gel's borders")
    values = shade(sensor, position, gel_normals(sensor, position[1], position[2]))
    return RayGrid(samples, u, v, np.zeros(rows), depth, values, pitch**2, sensor.near_m)


@lru_cache(maxsize=8)
def coverage_grid(sensor: Sensor, samples: int) -> RayGrid:
    """Rays of `sensor` that find what covers a pixel: `samples`^2 a pixel, no two in one row or column.

    Each row of a pixel has one ray, in a column of its own, so that edges near the image's axes are as finely
    resolved as others (for 2 x 2 the pattern of OpenGL's and Direct3D's multisampling, as TACTO is drawn
    with): `u` descends by pixels, `v` by rays.

    Raises
    ------
    ValueError
        As `ray_grid`.
    """
    even = ray_grid(sensor, samples)
    count = samples * samples
    rows, columns = sensor.image_height * count, sensor.image_width
    pitch = float(2 * np.tan(np.radians(sensor.field_of_view_deg) / 2)) / sensor.image_height
    v = (sensor.image_height / 2 - (np.arange(rows) + 0.5) / count) * pitch
    u = (columns / 2 - (np.arange(columns) + 0.5)) * pitch
    # An even grid of samples x samples, sheared: row a n + b of a pixel takes column (n - 1 - b) n + a.
    a, b = np.divmod(np.arange(count), samples)
    place = ((samples - 1 - b) * samples + a + 0.5) / count
    shift = np.tile((0.5 - place) * pitch, sensor.image_height)
    depth = gel_along_rays(sensor, u + shift[:, None], np.broadcast_to(v[:, None], (rows, columns)))
    values = resolve(even.gel_values, sensor, samples).reshape(-1, 3)
    return RayGrid(samples, u, v, shift, depth.ravel(), values, pitch**2 / count, sensor.near_m)


def resolve(values: np.ndarray, sensor: Sensor, samples: int) -> np.ndarray:
    """Mean over the samples of each pixel: (rows * columns, ...) to (height, width, ...)."""
    shape = (sensor.image_height, samples, sensor.image_width, samples, *values.shape[1:])
    blocks = values.reshape(shape)
    total = blocks[:, 0, :, 0].copy()
    for sample in range(1, samples * samples):
        total += blocks[:, sample // samples, :, sample % samples]
    total *= values.dtype.type(1 / (samples * samples))
    return np.asarray(total)


def to_bytes(values: np.ndarray) -> np.ndarray:
    """8-bit pixels of values in 0..1, rounded to nearest."""
    return (values * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def no_contact_image(sensor: Sensor, samples: int = 2) -> np.ndarray:
    """Image (height, width, 3) uint8 of the gel that nothing touches."""
    return to_bytes(resolve(ray_grid(sensor, samples).gel_values, sensor, samples))
