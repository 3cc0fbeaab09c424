"""Cameras and lights as a query gives them: one or many of each."""

import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from objectfolder.errors import QueryError
from objectfolder.query_values import image_sides, real, real_array, whole

LARGEST_COORDINATE = (
    1e6  # coordinate of a camera or a light, times the object's size: its square is a float32
)
LARGEST_COLOUR = 1e6  # factor of the data set's light


@dataclass(frozen=True)
class ViewQuery:
    """n views of k lights each, float64.

    Parameters
    ----------
    cameras
        (n, 4, 4) poses.
    lights
        (n, k, 3) positions.
    colours
        (n, k, 3) factors of the data set's light in each channel.
    """

    cameras: np.ndarray
    lights: np.ndarray
    colours: np.ndarray


def view_query(camera_to_object: ArrayLike, lights: ArrayLike, colours: ArrayLike | None = None) -> ViewQuery:
    """Return cameras and lights with every dimension spelt out.

    Parameters
    ----------
    camera_to_object
        (4, 4) or (n, 4, 4) rigid poses.
    lights
        (3,), one light for all views; (n, 3), one a view; (n, k, 3) or (1, k, 3), k in each.
    colours
        (3,), of every light; (k, 3); (n, k, 3) or (1, k, 3). White if None.

    Raises
    ------
    QueryError
        Shapes that do not match, values that are not finite, a pose that is not rigid.
    """
    cameras = real_array("camera_to_object", camera_to_object)
    cameras = cameras[None] if cameras.ndim == 2 else cameras
    if cameras.ndim != 3 or cameras.shape[1:] != (4, 4):
        raise QueryError("camera_to_object", f"shape {cameras.shape}", "Give (n, 4, 4) poses.")
    rotation = cameras[:, :3, :3]
    rigid = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0) <= 1e-4
    if not rigid or (np.linalg.det(rotation) < 0).any() or (cameras[:, 3] != [0, 0, 0, 1]).any():
        remedy = "Give an orthonormal rotation without a mirror, a translation, and 0 0 0 1 below."
        raise QueryError("camera_to_object", "not a rigid pose", remedy)
    positions = real_array("lights", lights)
    shape = positions.shape
    if positions.ndim in (1, 2) and positions.shape[-1] == 3:
        positions = positions.reshape(-1, 1, 3)
    if positions.ndim != 3 or positions.shape[2] != 3 or len(positions) not in (1, len(cameras)):
        raise QueryError(
            "lights",
            f"shape {shape} for {len(cameras)} cameras",
            "Give (3,) or (n, 3), one light a camera, or (n, k, 3), k lights a camera.",
        )
    positions = np.broadcast_to(positions, (len(cameras), *positions.shape[1:]))
    return ViewQuery(cameras, positions, light_colours(colours, positions.shape))


def light_colours(colours: ArrayLike | None, shape: tuple[int, ...]) -> np.ndarray:
    """Return the colours of lights, float64 of `shape` (..., k, 3); 1 if None.

    Raises
    ------
    QueryError
        A shape that does not fit that of the lights, or values not within 0 to `LARGEST_COLOUR`.
    """
    factors = np.ones(3) if colours is None else real_array("colours", colours)
    # A colour for each light: one that numpy would repeat over a longer axis of another meaning is refused.
    fits = factors.shape == (3,) or (
        1 < factors.ndim <= len(shape)
        and factors.shape[-2:] == shape[-2:]
        and factors.shape[:-2] in ((), (1,), shape[:-2])
    )
    if not fits:
        raise QueryError(
            "colours",
            f"shape {factors.shape} for lights {shape}",
            "Give (3,) for all lights, or (k, 3) or (n, k, 3), red, green and blue of each.",
        )
    if not ((factors >= 0) & (factors <= LARGEST_COLOUR)).all():
        raise QueryError("colours", "a value out of range", f"Give 0 to {LARGEST_COLOUR:g}.")
    return np.broadcast_to(factors, shape)


def ray_query(origins: ArrayLike, directions: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the rays (n, 3) of a query with directions of length 1.

    Raises
    ------
    QueryError
        Shapes that do not match, values that are not finite, a direction without length.
    """
    starts = np.atleast_2d(real_array("origins", origins))
    along = np.atleast_2d(real_array("directions", directions))
    if along.ndim != 2 or along.shape[1] != 3 or starts.shape not in ((1, 3), along.shape):
        raise QueryError(
            "origins, directions",
            f"shapes {np.shape(origins)} and {np.shape(directions)}",
            "Give (n, 3) directions, and (n, 3) origins or one.",
        )
    length = np.linalg.norm(along, axis=1, keepdims=True)
    if not (length > 0).all():
        raise QueryError("directions", "one has no length", "Give vectors along the rays.")
    return np.broadcast_to(starts, along.shape), along / length


def image_query(
    resolution: Any, field_of_view: Any, sub_rays: Any, most_sub_rays: int
) -> tuple[tuple[int, int], float, int]:
    """Return (height, width) in pixels, the field of view in degrees, and the rays a pixel, of these types.

    Raises
    ------
    QueryError
        Another type, or a number out of range.
    """
    rays = whole("sub_rays", sub_rays, 1, most_sub_rays)
    return image_sides(resolution, 1), real("field_of_view_deg", field_of_view, 0.0, 180.0, " degrees"), rays


def pass_names(passes: Any, known: Sequence[str]) -> tuple[str, ...]:
    """Return which passes a query wants; the first of `known` if None.

    Raises
    ------
    QueryError
        None of them, or one that is not known.
    """
    if passes is None:
        return (known[0],)
    names = tuple(passes) if np.iterable(passes) and not isinstance(passes, str) else ()
    for name in names or (passes,):
        if name not in known:
            raise QueryError("passes", reprlib.repr(name), f"Give a list of some of {', '.join(known)}.")
    return names


def require_near(name: str, positions: np.ndarray) -> None:
    """Refuse positions, unit frame, beyond `LARGEST_COORDINATE`.

    Raises
    ------
    QueryError
        One of them.
    """
    if not np.abs(positions).max(initial=0.0) <= LARGEST_COORDINATE:
        raise QueryError(
            name, f"more than {LARGEST_COORDINATE:g} times the object's size away", "Come nearer."
        )
