"""Values of textures between their texels."""

import numpy as np


def bilinear(image: np.ndarray, texture_coordinates: np.ndarray) -> np.ndarray:
    """Interpolate an image that repeats, as stored: encoded colours are interpolated encoded.

    This is what Cycles and graphics hardware without sRGB decoding do.

    Parameters
    ----------
    image
        (h, w, c) uint8, row 0 on top.
    texture_coordinates
        (n, 2) u, v, v up; the centre of the first texel of the last row is (0.5 / w, 0.5 / h).

    Returns
    -------
    np.ndarray
        (n, c) float32 in 0..1.
    """
    height, width, channels = image.shape
    if (height, width) == (1, 1):
        constant = image.reshape(1, channels) / np.float32(255)
        return np.broadcast_to(constant, (len(texture_coordinates), channels))
    u, v = texture_coordinates.T
    x, y = u % 1.0 * width - 0.5, (1.0 - v) % 1.0 * height - 0.5
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right_share = (x - left).astype(np.float32)[:, None]
    below_share = (y - top).astype(np.float32)[:, None]
    left, right = left % width, (left + 1) % width
    texels = image.reshape(-1, channels)

    def row(place: np.ndarray) -> np.ndarray:
        first = place % height * width
        at_left, at_right = texels.take(first + left, axis=0), texels.take(first + right, axis=0)
        return np.asarray(at_left * (1 - right_share) + at_right * right_share)

    above, below = row(top), row(top + 1)
    return np.asarray((above * (1 - below_share) + below * below_share) / np.float32(255))
