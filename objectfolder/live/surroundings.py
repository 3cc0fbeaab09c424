"""A wooden table and a soft backdrop, drawn by code, for scenes that people look at."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.live.scene_view import View

Floats = NDArray[np.float64]
PLANK_M = 0.11  # width of a plank
LIGHT_WOOD, DARK_WOOD = (0.52, 0.34, 0.19), (0.26, 0.145, 0.07)  # linear albedo
# Of value noise along (x) and across (y) the grain: cycles a metre, and share of the change of colour.
GRAIN = ((2.0, 60.0, 0.45), (5.0, 170.0, 0.30), (14.0, 520.0, 0.25))
SEAM_M, SEAM_SHARE = 0.0012, 0.45  # between planks: width, and share of the light that it takes
PLANK_CHANGE = 0.35  # of planks, as a share of that from light to dark
# sRGB of the backdrop towards the horizon, overhead and below.
HORIZON, OVERHEAD, BELOW = (0.93, 0.90, 0.86), (0.62, 0.70, 0.80), (0.55, 0.50, 0.46)


def wood_albedo(points_m: Floats, pixel_m: Floats) -> Floats:
    """Return the linear albedo (h, w, 3) of planks that run along x.

    Parameters
    ----------
    points_m
        (h, w, 2) places on the table; NaN where there is none.
    pixel_m
        (h, w) width of a pixel there. Grain that is finer fades, so that it does not alias.
    """
    x, y = np.nan_to_num(points_m[..., 0]), np.nan_to_num(points_m[..., 1])
    plank = np.floor(y / PLANK_M)
    seed = _hashed(plank, np.zeros_like(plank))
    x = x + 7.0 * seed
    y_own = y + 0.004 * np.sin(2 * np.pi * (1.3 * x + seed))
    share = 0.4 + PLANK_CHANGE * (seed - 0.5)
    for along, across, weight in GRAIN:
        fading = np.exp(-((pixel_m * across) ** 2))
        share = share + weight * fading * (_noise(x * along, y_own * across) - 0.5)
    edge_m = PLANK_M * np.abs(y / PLANK_M - np.rint(y / PLANK_M))
    seam = (
        SEAM_SHARE
        * SEAM_M
        / np.maximum(pixel_m, SEAM_M)
        * np.exp(-((edge_m / np.maximum(pixel_m, SEAM_M)) ** 2))
    )
    share = np.clip(share, 0.0, 1.0)[..., None]
    albedo: Floats = ((1 - share) * LIGHT_WOOD + share * np.array(DARK_WOOD)) * (1 - seam[..., None])
    return albedo


def backdrop(view: View) -> Floats:
    """Return the sRGB colours (h, w, 3) behind everything: by the height at which each ray ends."""
    height = view.rays[..., 2, None]
    above, below = np.clip(height, 0.0, 1.0) ** 0.6, np.clip(-height, 0.0, 1.0) ** 0.6
    colours: Floats = HORIZON + above * np.subtract(OVERHEAD, HORIZON) + below * np.subtract(BELOW, HORIZON)
    return colours


def _noise(x: Floats, y: Floats) -> Floats:
    """Return smooth values (...) in 0..1, drawn at whole places."""
    left, low = np.floor(x), np.floor(y)
    across, up = _smooth(x - left), _smooth(y - low)
    rows = [
        _hashed(left, low + step) * (1 - across) + _hashed(left + 1, low + step) * across for step in (0, 1)
    ]
    return rows[0] * (1 - up) + rows[1] * up


def _smooth(share: Floats) -> Floats:
    return share * share * (3 - 2 * share)


def _hashed(x: Any, y: Any) -> Floats:
    """Return a value in 0..1 of each whole place, the same on all machines."""
    number = x.astype(np.int64).astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    number += y.astype(np.int64).astype(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F)
    number = (number ^ (number >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed: Floats = ((number ^ (number >> np.uint64(32))) >> np.uint64(11)) / float(1 << 53)
    return mixed
