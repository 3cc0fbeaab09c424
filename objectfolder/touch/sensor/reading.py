"""What a real sensor adds to a touch, on reading: its background, as TACTO calibrates images, and its noise.

Stored touches are without either.
"""

from collections.abc import Sequence

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.touch.sensor.camera import no_contact_image, ray_grid
from objectfolder.touch.sensor.sensor import Sensor

# Kernels of OpenCV's GaussianBlur where no deviation is given; wider ones follow its formula for it.
SMALL_KERNELS = {
    1: (1.0,),
    3: (0.25, 0.5, 0.25),
    5: (0.0625, 0.25, 0.375, 0.25, 0.0625),
    7: (0.03125, 0.109375, 0.21875, 0.28125, 0.21875, 0.109375, 0.03125),
    9: tuple(part / 256 for part in (4, 13, 30, 51, 60, 51, 30, 13, 4)),
}


def calibrated(rgb: np.ndarray, no_contact: np.ndarray, background: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Lay touches over a background: background + blur of gain x (touch - untouched gel).

    Gain and blur are the sensor's: a half and 7 x 7 in TACTO 0.0.3 (`Renderer._calibrate`), which this
    equals, rounding down included.

    Parameters
    ----------
    rgb
        (height, width, 3) or (n, height, width, 3) uint8, as `press` gives them.
    no_contact
        (height, width, 3) uint8, the untouched gel in the same way.
    background
        (height, width, 3) uint8, what the real sensor sees when nothing touches it.

    Returns
    -------
    np.ndarray
        Of the shape of `rgb`, uint8.

    Raises
    ------
    QueryError
        A background of another size or type than the images.
    """
    # Here: an Object File opens without SciPy.
    from scipy.ndimage import correlate1d

    background = checked_background(background, sensor)
    images = rgb if rgb.ndim == 4 else rgb[None]
    kernel = background_kernel(sensor)
    laid = np.empty_like(images)
    for index, image in enumerate(images):
        difference = (image.astype(np.float64) - no_contact) * sensor.background_gain
        for axis in (0, 1):
            # Mirrored at the borders without repeating them.
            difference = correlate1d(difference, kernel, axis, mode="mirror")
        laid[index] = np.clip(difference + background, 0, 255)
    return laid.reshape(rgb.shape)


def checked_background(background: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return a background of the size of a sensor's images.

    Raises
    ------
    QueryError
        Another size or type.
    """
    shape = (sensor.image_height, sensor.image_width, 3)
    if isinstance(background, np.ndarray) and background.shape == shape and background.dtype == np.uint8:
        return background
    given = (
        f"{background.dtype} of shape {background.shape}"
        if isinstance(background, np.ndarray)
        else "no array"
    )
    raise QueryError("background", given, f"Give a uint8 image of shape {shape}.")


def background_kernel(sensor: Sensor) -> np.ndarray:
    """Weights (size,) by which the difference of a touch from the untouched gel is blurred."""
    if sensor.background_blur_m == 0:
        return blur_kernel(sensor.background_blur_pixels)
    away = sensor.gel_apex_m[0] - sensor.camera_position_m[0]
    height_m = 2 * away * np.tan(np.radians(sensor.field_of_view_deg) / 2)
    deviation = sensor.background_blur_m * sensor.image_height / height_m
    reach = min(max(1, int(np.ceil(3 * deviation))), sensor.image_height)
    weights = np.exp(-((np.arange(2 * reach + 1) - reach) ** 2) / (2 * deviation**2))
    return np.asarray(weights / weights.sum())


def blur_kernel(size: int) -> np.ndarray:
    """Weights (size,) of OpenCV's GaussianBlur of an odd size with no deviation given."""
    if size in SMALL_KERNELS:
        return np.array(SMALL_KERNELS[size])
    deviation = 0.3 * ((size - 1) / 2 - 1) + 0.8
    weights = np.exp(-((np.arange(size) - size // 2) ** 2) / (2 * deviation**2))
    return np.asarray(weights / weights.sum())


def synthetic_background(sensor: Sensor, seed: int, samples: int = 2) -> np.ndarray:
    """Draw a background where no real one is at hand; stated, not measured.

    The untouched gel, darkened towards its corners by the fourth power of the cosine of the angle to the
    camera's axis, its channels brighter or darker by up to 10 % as between two sensors of one make,
    and uneven by up to 3 % over its width and height.

    Parameters
    ----------
    seed
        0 or more; stands for a unit of the sensor.

    Returns
    -------
    np.ndarray
        (height, width, 3) uint8.
    """
    random = np.random.default_rng([seed, 3])
    grid = ray_grid(sensor, 1)
    cosine_squared = 1 / (1 + grid.u[None, :] ** 2 + grid.v[:, None] ** 2)
    balance = 1 + 0.1 * random.uniform(-1, 1, 3)
    waves, phases = random.uniform(-np.pi, np.pi, (3, 2)), random.uniform(0, 2 * np.pi, 3)
    across = np.linspace(-1, 1, sensor.image_width)[None, :, None]
    up = np.linspace(1, -1, sensor.image_height)[:, None, None]
    unevenness = 1 + 0.03 * np.cos(waves[:, 0] * across + waves[:, 1] * up + phases)
    values = no_contact_image(sensor, samples) * (cosine_squared**2)[..., None] * balance * unevenness
    return np.asarray(np.clip(np.rint(values), 0, 255).astype(np.uint8))


def with_noise(rgb: np.ndarray, sensor: Sensor, seed: int | Sequence[int]) -> np.ndarray:
    """Add the sensor's Gaussian noise to images.

    Each value gets noise of its own, of standard deviation `sensor.noise_sigma_grey_levels`, as in TACTO;
    the sum is rounded to the nearest grey level (TACTO's is rounded down, which darkens by half a level).

    Parameters
    ----------
    rgb
        (height, width, 3) or (n, height, width, 3) uint8.
    seed
        0 or more. The noise of an image is set by the seed and its row: more images change none of it. Or one
        seed an image, whose noise is then as if it were alone.

    Returns
    -------
    np.ndarray
        Of the same shape, uint8.
    """
    images = rgb if rgb.ndim == 4 else rgb[None]
    noisy = np.empty_like(images)
    for index, image in enumerate(images):
        random = np.random.default_rng([seed, index] if isinstance(seed, int) else [seed[index], 0])
        noise = random.standard_normal(image.shape, dtype=np.float32)
        noise *= np.float32(sensor.noise_sigma_grey_levels)
        noise += image
        noisy[index] = np.clip(np.rint(noise, out=noise), 0, 255, out=noise)
    return noisy.reshape(rgb.shape)
