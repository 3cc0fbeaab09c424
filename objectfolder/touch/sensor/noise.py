"""The camera's noise, added on reading: stored touches are without."""

import numpy as np

from objectfolder.touch.sensor.sensor import Sensor


def with_noise(rgb: np.ndarray, sensor: Sensor, seed: int) -> np.ndarray:
    """Add the sensor's Gaussian noise to images.

    Each value gets noise of its own, of standard deviation `sensor.noise_sigma_grey_levels`, as in TACTO;
    the sum is rounded to the nearest grey level (TACTO's is rounded down, which darkens by half a level).

    Parameters
    ----------
    rgb
        (height, width, 3) or (n, height, width, 3) uint8.
    seed
        0 or more. The noise of an image is set by the seed and its row: more images change none of it.

    Returns
    -------
    np.ndarray
        Of the same shape, uint8.
    """
    images = rgb if rgb.ndim == 4 else rgb[None]
    noisy = np.empty_like(images)
    for index, image in enumerate(images):
        random = np.random.default_rng([seed, index])
        noise = random.standard_normal(image.shape, dtype=np.float32)
        noise *= np.float32(sensor.noise_sigma_grey_levels)
        noise += image
        noisy[index] = np.clip(np.rint(noise, out=noise), 0, 255, out=noise)
    return noisy.reshape(rgb.shape)
