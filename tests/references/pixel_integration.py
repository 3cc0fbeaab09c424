"""From radiance along rays to pixels: few rays where a pixel is even, many where something ends in it."""

from collections.abc import Callable, Iterator

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.vision.cameras import image_crop, pixel_rays, sub_ray_offsets
from objectfolder.vision.compositing import composite_on_white
from objectfolder.vision.rendering.pixel_centres import CAST_RAYS, box_in_view

# An even pixel gets this share of the rays of an uneven one.
SAVING = 8
# Range of the rays of an even pixel in alpha and in sRGB on white.
EVEN_WITHIN = 0.1

Radiance = Callable[[np.ndarray, np.ndarray], np.ndarray]


def integrate_pixels(
    radiance: Radiance,
    camera_to_world: np.ndarray,
    size: tuple[int, int],
    field_of_view_deg: float,
    sub_rays: int,
    corners: np.ndarray,
    *,
    crop: tuple[int, int, int, int] | None = None,
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
    crop
        (top, left, height, width) of the part that is wanted, pixels. It equals that part of the whole image
        bit for bit where `radiance` answers each ray alike in any company.

    Returns
    -------
    np.ndarray
        (height, width, 4) float32, of the crop if there is one.

    Raises
    ------
    QueryError
        Fewer than one ray, a crop outside the image.
    """
    if sub_rays < 1:
        raise QueryError("sub_rays", f"{sub_rays} rays a pixel", "Use 1, 4, 16 or 64.")
    few = max(1, sub_rays // SAVING)
    top, left, height, width = image_crop(crop, size)
    # What is uneven is seen in the neighbours, too: the window is one pixel wider.
    first_row, first_column = max(0, top - 1), max(0, left - 1)
    shape = min(size[0], top + height + 1) - first_row, min(size[1], left + width + 1) - first_column
    crop_mask = np.zeros(shape, dtype=bool)
    crop_mask[top - first_row :, left - first_column :][:height, :width] = True

    def traced(places: np.ndarray, count: int) -> np.ndarray:
        row, column = np.divmod(places, shape[1])
        pixels = (row + first_row) * size[1] + column + first_column
        rays = pixel_rays(camera_to_world, pixels, sub_ray_offsets(count), size, field_of_view_deg)
        return radiance(*rays).reshape(len(pixels), count, 4)

    rows, columns = box_in_view(corners, camera_to_world, size, field_of_view_deg)
    rows = rows[(rows >= first_row) & (rows < first_row + shape[0])] - first_row
    columns = columns[(columns >= first_column) & (columns < first_column + shape[1])] - first_column
    image = np.zeros((shape[0] * shape[1], 4), dtype=np.float32)
    uneven = np.zeros(len(image), dtype=bool)
    for places in _chunks((rows[:, None] * shape[1] + columns).ravel(), few):
        rays = traced(places, few)
        image[places] = rays.mean(axis=1)
        shown = np.concatenate([composite_on_white(rays), rays[..., 3:]], axis=-1)
        uneven[places] = (np.ptp(shown, axis=1) > EVEN_WITHIN).any(axis=1)
    if few < sub_rays:
        uneven |= _outline(image[:, 3].reshape(shape)).ravel()
        for places in _chunks(np.flatnonzero(uneven & crop_mask.ravel()), sub_rays):
            image[places] = traced(places, sub_rays).mean(axis=1)
    return image[crop_mask.ravel()].reshape(height, width, 4)


def _outline(alpha: np.ndarray) -> np.ndarray:
    """Mark pixels whose alpha differs from a neighbour's, (h, w) bool."""
    marked = np.zeros(alpha.shape, dtype=bool)
    for first, second in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        differs = alpha[first] != alpha[second]
        marked[first] |= differs
        marked[second] |= differs
    return marked


def _chunks(pixels: np.ndarray, rays: int) -> Iterator[np.ndarray]:
    step = max(1, CAST_RAYS // rays)
    for start in range(0, len(pixels), step):
        yield pixels[start : start + step]
