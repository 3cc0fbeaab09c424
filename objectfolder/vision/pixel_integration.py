"""From radiance along rays to pixels: few rays where a pixel is even, many where something ends in it."""

from collections.abc import Callable, Iterator

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.vision.cameras import focal_length_px, pixel_rays, sub_ray_offsets
from objectfolder.vision.compositing import composite_on_white

# An even pixel gets this share of the rays of an uneven one.
SAVING = 8
# Range of the rays of an even pixel in alpha and in sRGB on white.
EVEN_WITHIN = 0.1
# Rays traced at a time: bounds the memory of a render.
CHUNK = 1 << 16

Radiance = Callable[[np.ndarray, np.ndarray], np.ndarray]


def integrate_pixels(
    radiance: Radiance,
    camera_to_world: np.ndarray,
    size: tuple[int, int],
    field_of_view_deg: float,
    sub_rays: int,
    corners: np.ndarray,
) -> np.ndarray:
    """Average `radiance` over the pixels of one view (a box filter).

    Parameters
    ----------
    radiance
        Maps origins and directions (n, 3) to (n, 4) premultiplied RGBA.
    camera_to_world
        (4, 4) pose.
    size
        (height, width), pixels.
    field_of_view_deg
        Angle over the longer side.
    sub_rays
        Rays in an uneven pixel; an even one, and each at first, gets an eighth of them.
    corners
        (n, 3) points whose convex hull holds everything there is to see.

    Returns
    -------
    np.ndarray
        (height, width, 4) float32.

    Raises
    ------
    QueryError
        Fewer than one ray.
    """
    if sub_rays < 1:
        raise QueryError("sub_rays", f"{sub_rays} rays a pixel", "Use 1, 4, 16 or 64.")
    few = max(1, sub_rays // SAVING)

    def traced(pixels: np.ndarray, count: int) -> np.ndarray:
        rays = pixel_rays(camera_to_world, pixels, sub_ray_offsets(count), size, field_of_view_deg)
        return radiance(*rays).reshape(len(pixels), count, 4)

    image = np.zeros((size[0] * size[1], 4), dtype=np.float32)
    uneven = np.zeros(len(image), dtype=bool)
    for pixels in _chunks(pixels_in_view(corners, camera_to_world, size, field_of_view_deg), few):
        rays = traced(pixels, few)
        image[pixels] = rays.mean(axis=1)
        shown = np.concatenate([composite_on_white(rays), rays[..., 3:]], axis=-1)
        uneven[pixels] = (np.ptp(shown, axis=1) > EVEN_WITHIN).any(axis=1)
    if few < sub_rays:
        uneven |= _outline(image[:, 3].reshape(size)).ravel()
        for pixels in _chunks(np.flatnonzero(uneven), sub_rays):
            image[pixels] = traced(pixels, sub_rays).mean(axis=1)
    return image.reshape(*size, 4)


def pixels_in_view(
    corners: np.ndarray, camera_to_world: np.ndarray, size: tuple[int, int], field_of_view_deg: float
) -> np.ndarray:
    """Return the flat indices of the pixels in the box around the image of (n, 3) points."""
    height, width = size
    local = (corners - camera_to_world[:3, 3]) @ camera_to_world[:3, :3]
    depth = -local[:, 2]
    if depth.max(initial=0.0) <= 0:
        return np.zeros(0, dtype=np.int64)
    if depth.min() <= 1e-6:
        # Points beside or behind the camera have no image: look everywhere.
        return np.arange(height * width)
    focal = focal_length_px(size, field_of_view_deg)
    x = width / 2 + focal * local[:, 0] / depth
    y = height / 2 - focal * local[:, 1] / depth
    columns = np.arange(max(0, int(np.floor(x.min()))), min(width, int(np.ceil(x.max())) + 1))
    rows = np.arange(max(0, int(np.floor(y.min()))), min(height, int(np.ceil(y.max())) + 1))
    return (rows[:, None] * width + columns).ravel()


def _outline(alpha: np.ndarray) -> np.ndarray:
    """Mark pixels whose alpha differs from a neighbour's, (h, w) bool."""
    marked = np.zeros(alpha.shape, dtype=bool)
    for one, other in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        differs = alpha[one] != alpha[other]
        marked[one] |= differs
        marked[other] |= differs
    return marked


def _chunks(pixels: np.ndarray, rays: int) -> Iterator[np.ndarray]:
    step = max(1, CHUNK // rays)
    for start in range(0, len(pixels), step):
        yield pixels[start : start + step]
