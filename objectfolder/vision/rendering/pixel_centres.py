"""What lies at the centre of each pixel, one ray a pixel: depth, normal, mask, and which points these are.

A mean over a pixel would be the depth of no point at a silhouette, and the normal of none at a crease.
"""

from dataclasses import dataclass

import numpy as np

from objectfolder.vision.cameras import focal_length_px, pixel_rays
from objectfolder.vision.network.incidence import UnitSurface

CENTRE = np.array([[0.5, 0.5]])
# Rays traced at a time: bounds the memory of a render.
CAST_RAYS = 1 << 16


@dataclass(frozen=True)
class PixelCentres:
    """The surface at the centres of h x w pixels.

    Parameters
    ----------
    depth
        (h, w) float32 distance along the camera's -z axis (not along the ray), unit frame; infinity where
        nothing is.
    normal
        (h, w, 3) float32 unit shading normal on the camera's side, axes of the unit frame; 0 elsewhere.
    mask
        (h, w) bool, whether anything is.
    face, barycentric
        (m,), (m, 3) points of the surface, in the order of the mask's pixels.
    """

    depth: np.ndarray
    normal: np.ndarray
    mask: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray


def cast_pixel_centres(
    surface: UnitSurface,
    camera_to_world: np.ndarray,
    size: tuple[int, int],
    field_of_view_deg: float,
    crop: tuple[int, int, int, int],
) -> PixelCentres:
    """Cast a ray through the centre of each pixel of a part of a view.

    Parameters
    ----------
    camera_to_world
        (4, 4) pose, unit frame.
    size
        (height, width) of the whole image.
    field_of_view_deg
        Angle over the longer side.
    crop
        (top, left, height, width) of the part.
    """
    top, left, height, width = crop
    depth = np.full(height * width, np.inf, dtype=np.float32)
    normal = np.zeros((height * width, 3), dtype=np.float32)
    rows, columns = box_in_view(surface.triangles.reshape(-1, 3), camera_to_world, size, field_of_view_deg)
    rows = rows[(rows >= top) & (rows < top + height)]
    columns = columns[(columns >= left) & (columns < left + width)]
    pixels = (rows[:, None] * size[1] + columns).ravel()
    met: list[tuple[np.ndarray, ...]] = [(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))]
    places = ((rows[:, None] - top) * width + columns - left).ravel()
    for start in range(0, len(pixels), CAST_RAYS):
        origins, directions = pixel_rays(
            camera_to_world, pixels[start : start + CAST_RAYS], CENTRE, size, field_of_view_deg
        )
        face, barycentric = surface.first_hits(origins, directions)
        hit = np.flatnonzero(face >= 0)
        face, barycentric, place = face[hit], barycentric[hit], places[start + hit]
        position = np.einsum("ij,ijk->ik", barycentric, surface.triangles[face])
        depth[place] = -np.einsum("ij,j->i", position - origins[hit], camera_to_world[:3, 2])
        normal[place] = surface.seen(face, barycentric, directions[hit])[1]
        met.append((face, barycentric))
    depth = depth.reshape(height, width)
    hits = (np.concatenate(column) for column in zip(*met, strict=True))
    return PixelCentres(depth, normal.reshape(height, width, 3), np.isfinite(depth), *hits)


def box_in_view(
    corners: np.ndarray, camera_to_world: np.ndarray, size: tuple[int, int], field_of_view_deg: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows and the columns of the pixels in the box around the image of (n, 3) points."""
    height, width = size
    local = (corners - camera_to_world[:3, 3]) @ camera_to_world[:3, :3]
    depth = -local[:, 2]
    if depth.max(initial=0.0) <= 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    if depth.min() <= 1e-6:
        # Points beside or behind the camera have no image: look everywhere.
        return np.arange(height), np.arange(width)
    focal = focal_length_px(size, field_of_view_deg)
    x = width / 2 + focal * local[:, 0] / depth
    y = height / 2 - focal * local[:, 1] / depth
    columns = np.arange(max(0, int(np.floor(x.min()))), min(width, int(np.ceil(x.max())) + 1))
    rows = np.arange(max(0, int(np.floor(y.min()))), min(height, int(np.ceil(y.max())) + 1))
    return rows, columns
