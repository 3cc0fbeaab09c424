"""Cameras and lights as a query gives them: one or many of each."""

from dataclasses import dataclass

import numpy as np

from objectfolder.errors import QueryError


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


def view_query(
    camera_to_world: np.ndarray, light_position: np.ndarray, light_colour: np.ndarray | None = None
) -> ViewQuery:
    """Return cameras and lights with every dimension spelt out.

    Parameters
    ----------
    camera_to_world
        (4, 4) or (n, 4, 4) rigid poses.
    light_position
        (3,), one light for all views; (n, 3), one a view; (n, k, 3) or (1, k, 3), k in each.
    light_colour
        (3,), of every light; (k, 3); (n, k, 3) or (1, k, 3). White if None.

    Raises
    ------
    QueryError
        Shapes that do not match, values that are not finite, a pose that is not rigid.
    """
    cameras = np.asarray(camera_to_world, dtype=np.float64)
    cameras = cameras[None] if cameras.ndim == 2 else cameras
    if cameras.ndim != 3 or cameras.shape[1:] != (4, 4):
        raise QueryError("camera_to_world", f"shape {cameras.shape}", "Give (n, 4, 4) poses.")
    _require_finite("camera_to_world", cameras)
    rotation = cameras[:, :3, :3]
    if np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0) > 1e-4:
        raise QueryError(
            "camera_to_world", "not a rigid pose", "Give an orthonormal rotation and a translation."
        )
    lights = np.asarray(light_position, dtype=np.float64)
    if lights.ndim in (1, 2):
        lights = lights.reshape(-1, 1, lights.shape[-1])
    if lights.ndim != 3 or lights.shape[2] != 3 or len(lights) not in (1, len(cameras)):
        raise QueryError(
            "light_position",
            f"shape {np.shape(light_position)} for {len(cameras)} cameras",
            "Give (3,) or (n, 3), one light a camera, or (n, k, 3), k lights a camera.",
        )
    _require_finite("light_position", lights)
    lights = np.broadcast_to(lights, (len(cameras), *lights.shape[1:]))
    return ViewQuery(cameras, lights, light_colours(light_colour, lights.shape))


def light_colours(light_colour: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    """Return the colours of lights, float64 of `shape` (..., k, 3); 1 if None.

    Raises
    ------
    QueryError
        A shape that does not fit that of the lights, or values that are not finite.
    """
    colours = np.ones(3) if light_colour is None else np.asarray(light_colour, dtype=np.float64)
    # A colour for each light: one that numpy would repeat over a longer axis of another meaning is refused.
    fits = colours.shape == (3,) or (
        1 < colours.ndim <= len(shape)
        and colours.shape[-2:] == shape[-2:]
        and colours.shape[:-2] in ((), (1,), shape[:-2])
    )
    if not fits:
        raise QueryError(
            "light_colour",
            f"shape {colours.shape} for lights {shape}",
            "Give (3,) for all lights, or (k, 3) or (n, k, 3), red, green and blue of each.",
        )
    _require_finite("light_colour", colours)
    return np.broadcast_to(colours, shape)


def ray_query(origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rays (n, 3) of a query with directions of length 1.

    Raises
    ------
    QueryError
        Shapes that do not match, values that are not finite, a direction without length.
    """
    starts, along = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
    starts, along = np.atleast_2d(starts), np.atleast_2d(along)
    if along.ndim != 2 or along.shape[1] != 3 or starts.shape not in ((1, 3), along.shape):
        raise QueryError(
            "origins, directions",
            f"shapes {np.shape(origins)} and {np.shape(directions)}",
            "Give (n, 3) directions, and (n, 3) origins or one.",
        )
    _require_finite("origins", starts)
    _require_finite("directions", along)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    if not (length > 0).all():
        raise QueryError("directions", "one has no length", "Give vectors along the rays.")
    return np.broadcast_to(starts, along.shape), along / length


def _require_finite(name: str, values: np.ndarray) -> None:
    if not np.isfinite(values).all():
        raise QueryError(name, "not finite", "Give numbers.")
