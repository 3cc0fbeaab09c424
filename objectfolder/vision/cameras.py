"""Cameras, lights and pixel rays: the projection that Cycles and VisionNet share.

A camera is a 4x4 `camera_to_world` matrix in the OpenGL convention: it looks along its -z axis, +y is
up in the image, and row 0 of an image is its top. The field of view spans the longer side of the image.
"""

import math
import reprlib

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.query_values import MOST_PIXELS, whole

CAMERA_RADIUS = 2.5
LIGHT_RADIUS = 1.0
FIELD_OF_VIEW_DEG = 39.6
# Within this cosine of the pole the z axis no longer fixes the roll and y takes its place.
POLE_COSINE = 0.9999
# Where the lamp of a view is that names none, in the camera's axes: right, up, towards the camera.
LAMP_DIRECTION = (-1.0, 1.0, 2.0)
GOLDEN_RATIO = (math.sqrt(5.0) - 1.0) / 2.0


def uniform_on_sphere(count: int, radius: float, generator: np.random.Generator) -> np.ndarray:
    """Return (count, 3) points uniform by area on the sphere of `radius` about the origin.

    The lights of the data set lie on the unit sphere of the unit frame. The object's box has half
    sides of at most 1/2 there, its corners reach at most 0.866, so a light is never inside the object
    and at least 0.134 from it; the inverse square law still spans a factor of 200.
    """
    # Point by point, so that the first of many are the same as few.
    height, angle = (generator.random((count, 2)) * [2.0, 2.0 * math.pi] - [1.0, 0.0]).T
    ring = np.sqrt(1.0 - height**2)
    return radius * np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)


def look_at(positions: np.ndarray, target: np.ndarray | None = None) -> np.ndarray:
    """Return the (n, 4, 4) poses of cameras at (n, 3) `positions` looking at `target` (the origin).

    +z is up in the image, or +y for a camera that looks along z.

    Raises
    ------
    QueryError
        A camera at its own target.
    """
    positions = np.atleast_2d(np.asarray(positions, dtype=np.float64))
    backward = positions - (np.zeros(3) if target is None else np.asarray(target, dtype=np.float64))
    distance = np.linalg.norm(backward, axis=1, keepdims=True)
    if not np.all(distance > 0):
        raise QueryError("camera", "its position is its target", "Move one of them.")
    backward = backward / distance
    up = np.where(np.abs(backward[:, 2:]) > POLE_COSINE, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    right = np.cross(up, backward)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 0] = right
    poses[:, :3, 1] = np.cross(backward, right)
    poses[:, :3, 2] = backward
    poses[:, :3, 3] = positions
    return poses


def lamps_at_cameras(camera_to_world: np.ndarray) -> np.ndarray:
    """Return a lamp of the data set for each (n, 4, 4) pose: (n, 3) on the sphere of `LIGHT_RADIUS`.

    It is on the camera's side, to the left and above, so that shading shows the shape.
    """
    direction = LIGHT_RADIUS * np.array(LAMP_DIRECTION) / np.linalg.norm(LAMP_DIRECTION)
    return np.asarray(camera_to_world)[:, :3, :3] @ direction


def image_size(resolution: int | tuple[int, int]) -> tuple[int, int]:
    """Return (height, width) in pixels of a resolution given as one number or two.

    Raises
    ------
    QueryError
        A side below one pixel.
    """
    height, width = (resolution, resolution) if isinstance(resolution, int | np.integer) else resolution
    if height < 1 or width < 1:
        raise QueryError("resolution", f"{height} x {width} pixels", "Ask for at least one pixel a side.")
    return int(height), int(width)


def image_crop(crop: tuple[int, int, int, int] | None, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Return the (top, left, height, width) of a part of an image in pixels; the whole one if None.

    Raises
    ------
    QueryError
        A part without a pixel, or one that reaches past the image.
    """
    if crop is None:
        return 0, 0, *size
    values = tuple(crop) if np.iterable(crop) else ()
    if len(values) != 4:
        finding = f"{len(values)} numbers" if values else reprlib.repr(crop)
        raise QueryError("crop", finding, "Give (top, left, height, width) in pixels.")
    top, left, height, width = (whole("crop", value, -MOST_PIXELS, MOST_PIXELS) for value in values)
    if min(top, left) < 0 or min(height, width) < 1 or top + height > size[0] or left + width > size[1]:
        raise QueryError(
            "crop",
            f"{height} x {width} pixels at row {top}, column {left}",
            f"Stay within the image, {size[0]} x {size[1]} pixels.",
        )
    return top, left, height, width


def focal_length_px(resolution: int | tuple[int, int], field_of_view_deg: float) -> float:
    """Return the focal length in pixels; 355.56 for 256 pixels and 39.6 degrees.

    Raises
    ------
    QueryError
        A field of view outside (0, 180) degrees.
    """
    if not 0.0 < field_of_view_deg < 180.0:
        raise QueryError(
            "field_of_view", f"{field_of_view_deg} degrees", "Give an angle between 0 and 180 degrees."
        )
    return max(image_size(resolution)) / 2.0 / math.tan(math.radians(field_of_view_deg) / 2.0)


def sub_ray_offsets(sub_rays: int) -> np.ndarray:
    """Return (k, 2) positions (x, y) in the unit pixel: a Fibonacci lattice, centred.

    Its projections on both axes and on any slanted line are even, so that the share of the rays on one
    side of an edge is close to the area there; an axis-aligned grid of 64 knows only 8 heights.
    """
    index = np.arange(sub_rays)
    return np.stack([(index + 0.5) / sub_rays, (index * GOLDEN_RATIO + 0.5) % 1.0], axis=1)


def pixel_rays(
    pose: np.ndarray,
    pixels: np.ndarray,
    offsets: np.ndarray,
    resolution: int | tuple[int, int],
    field_of_view_deg: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rays of a pinhole camera through points inside pixels.

    Parameters
    ----------
    pose
        (4, 4) of the camera, in any frame.
    pixels
        (n,) flat pixel indices, row * width + column.
    offsets
        (k, 2) or (n, k, 2) positions (x, y) inside the pixel, from its top left corner, in pixels.

    Returns
    -------
    origins, directions
        (n * k, 3) each, in that frame, directions of length 1; the k rays of a pixel are adjacent.
    """
    height, width = image_size(resolution)
    focal = focal_length_px((height, width), field_of_view_deg)
    row, column = np.divmod(np.asarray(pixels), width)
    positions = np.stack([column, row], axis=-1)[:, None, :] + offsets
    x = (positions[..., 0] - width / 2.0) / focal
    y = (height / 2.0 - positions[..., 1]) / focal
    # Not a matrix product: libraries round that by the number of rays; a crop would differ from its image.
    right, up, backward = pose[:3, :3].T
    directions = (x[..., None] * right + y[..., None] * up - backward).reshape(-1, 3)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.broadcast_to(pose[:3, 3], directions.shape), directions


def project(
    points: np.ndarray,
    pose: np.ndarray,
    resolution: int | tuple[int, int],
    field_of_view_deg: float,
) -> np.ndarray:
    """Return the (n, 2) image positions (x, y) in pixels, from the top left corner, of (n, 3) points."""
    height, width = image_size(resolution)
    focal = focal_length_px((height, width), field_of_view_deg)
    local = (np.asarray(points, dtype=np.float64) - pose[:3, 3]) @ pose[:3, :3]
    return np.stack(
        [width / 2.0 - focal * local[:, 0] / local[:, 2], height / 2.0 + focal * local[:, 1] / local[:, 2]],
        axis=1,
    )


def image_box(
    points: np.ndarray,
    pose: np.ndarray,
    resolution: int | tuple[int, int],
    field_of_view_deg: float,
    margin_px: int = 0,
) -> tuple[int, int, int, int]:
    """Return (top, left, height, width) in pixels of the part of an image in which (n, 3) points lie.

    It is the whole image where a point is beside the camera or behind it, and so has no place there, and
    may be without pixels where all lie outside.
    """
    height, width = image_size(resolution)
    depth = (pose[:3, 3] - points) @ pose[:3, 2]
    if depth.min() <= 1e-6:
        return 0, 0, height, width
    places = project(points, pose, (height, width), field_of_view_deg)
    (left, top), (right, bottom) = np.floor(places.min(axis=0)), np.ceil(places.max(axis=0))
    rows, columns = (
        np.clip([first - margin_px, last + margin_px], 0, size).astype(int)
        for first, last, size in ((top, bottom, height), (left, right, width))
    )
    return int(rows[0]), int(columns[0]), int(np.ptp(rows)), int(np.ptp(columns))
