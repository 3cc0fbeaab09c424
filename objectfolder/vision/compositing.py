"""From scene-linear premultiplied RGBA to sRGB on white.

The convention is that of PNG and of the web: the *straight* colour is sRGB-encoded and then
alpha-blended over white in encoded space. Adding white in linear light and then encoding differs from
it by more than any renderer error on silhouettes.
"""

import numpy as np

SRGB_KNEE = 0.0031308


def srgb_encode(linear: np.ndarray) -> np.ndarray:
    """Encode linear values in [0, 1] by IEC 61966-2-1; values outside are clipped."""
    values = np.clip(linear, 0.0, 1.0)
    return np.where(
        values <= SRGB_KNEE, 12.92 * values, 1.055 * np.maximum(values, SRGB_KNEE) ** (1 / 2.4) - 0.055
    )


def srgb_decode(encoded: np.ndarray) -> np.ndarray:
    """Invert `srgb_encode`; values outside [0, 1] are clipped."""
    values = np.clip(encoded, 0.0, 1.0)
    return np.where(values <= 12.92 * SRGB_KNEE, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def composite_on(rgba: np.ndarray, behind: np.ndarray | float) -> np.ndarray:
    """Blend (..., 4) scene-linear premultiplied RGBA over sRGB-encoded colours, 1 for white.

    Returns
    -------
    np.ndarray
        (..., 3) sRGB-encoded values in [0, 1], float64.
    """
    values = np.asarray(rgba, dtype=np.float64)
    alpha = np.clip(values[..., 3:], 0.0, 1.0)
    straight = np.divide(values[..., :3], alpha, out=np.zeros_like(values[..., :3]), where=alpha > 0)
    return alpha * srgb_encode(straight) + (1.0 - alpha) * behind


def composite_on_white(rgba: np.ndarray) -> np.ndarray:
    """Return `composite_on` white."""
    return composite_on(rgba, 1.0)


def on_backdrop(rgba: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """Return `composite_on` colours (..., 3) rounded to uint8."""
    return np.round(composite_on(rgba, behind) * 255.0).astype(np.uint8)


def on_white(rgba: np.ndarray) -> np.ndarray:
    """Return `composite_on_white` rounded to uint8, (..., 3)."""
    shown = ~(rgba[..., 3] <= 0)  # elsewhere it is white, and most of a view is elsewhere
    image = np.full((*rgba.shape[:-1], 3), 255, dtype=np.uint8)
    image[shown] = np.round(composite_on_white(rgba[shown]) * 255.0).astype(np.uint8)
    return image
