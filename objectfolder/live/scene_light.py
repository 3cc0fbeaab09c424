"""What lights a scene: lamps in the world, and light from all round."""

import functools
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import QueryError
from objectfolder.live.scene_view import inverse_pose, moved_by
from objectfolder.query_values import real_array
from objectfolder.renaming import REMOVED_IN
from objectfolder.vision.environment import Environment, named_map, pixel_directions
from objectfolder.vision.lamps import Lamps

Floats = NDArray[np.float64]
Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
AS_THEY_ARE = (Lamps, Environment, str)  # beside these a list is no array of places
EARLIER = ("lamps_m", "lamp_colours", "environment")
# In the world: a key lamp on the left, a weaker one on the right, one above, metres; and their colours.
LAMPS_M = ((-0.6, -0.8, 1.2), (0.9, -0.6, 0.7), (0.2, 0.4, 1.6))
LAMP_COLOURS = ((1.0, 0.97, 0.92), (0.3, 0.32, 0.36), (0.3, 0.3, 0.3))


@dataclass(frozen=True)
class SceneLight:
    """Lamps and an environment in one frame.

    Parameters
    ----------
    lamps_m, colours
        (k, 3) places, and linear factors of the light that a data set's lamp gives at one metre.
    radiance
        (h, 2 h, 3) map of the environment, oriented as in `vision.environment`; None: there is none.
    above
        (3,) radiance of a matt white plane that faces +z, under the environment alone.
    towards, shares
        (m, 3) directions from which it comes, in the world, and (m, 3) what comes from each.
    around
        The environment in the world; None: there is none.
    """

    lamps_m: Floats
    colours: Floats
    radiance: Floats | None = None
    above: Floats = field(default_factory=lambda: np.zeros(3))
    towards: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    shares: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    around: Environment | None = None

    @classmethod
    def of(cls, lights: Any = None) -> "SceneLight":
        """Return the light of a scene, as `LiveSight` takes it.

        Raises
        ------
        QueryError
            Lamps or colours of other shapes, another environment than `ObjectFile.render` knows.
        """
        source, environment = _parts(lights)
        lamps = real_array("lights", source.positions_m)
        colours = np.ones(lamps.shape) if source.colours is None else real_array("lights", source.colours)
        if lamps.ndim != 2 or lamps.shape[1:] != (3,) or colours.shape != lamps.shape:
            finding = f"lamps of shape {lamps.shape} with colours of {colours.shape}"
            raise QueryError("lights", finding, "Give a place (3,) and a colour (3,) of each.")
        if environment is None:
            return cls(lamps, colours)
        sky = environment if isinstance(environment, Environment) else Environment.of(environment)
        rows = int(sky.heights[0])
        radiance = sky.texels[: 2 * rows**2].reshape(rows, 2 * rows, 3).astype(np.float64)
        if isinstance(environment, str):
            radiance = named_map(environment)
        edges = np.maximum(np.cos(np.pi * np.arange(rows + 1) / rows), 0.0)
        arriving = (edges[:-1] ** 2 - edges[1:] ** 2) / (2 * rows)  # cosine times solid angle, over pi
        above = np.tensordot(arriving, radiance.sum(axis=1), 1)
        up = sky.directions[:, 2] > 0
        shares = sky.powers[up] * sky.directions[up, 2:]
        shares *= above / np.maximum(shares.sum(axis=0), 1e-300)
        return cls(lamps, colours, radiance, above, sky.directions[up], shares, sky)

    def seen_by(
        self, pose: Floats, unit_m: float, around: Environment | None, turn: Floats | None = None
    ) -> "BodyLight":
        """Return the light in a body's frame, whose lamps are as strong at `unit_m` as these at a metre.

        What comes from all round is `around`, as `turned` returned it for that pose or one near it; or, with
        the `turn` (3, 3) from the body's frame to that, the environment of another frame.
        """
        lamps = moved_by(inverse_pose(pose), self.lamps_m), self.colours / unit_m**2
        return BodyLight(*lamps, around, np.eye(3) if turn is None else turn)

    def turned(self, pose: Floats) -> Environment | None:
        """Return the environment in a body's frame; None where there is none."""
        return None if self.radiance is None else Environment.of(_turned(self.radiance, pose[:3, :3]))


@dataclass(frozen=True)
class BodyLight:
    """Lamps (k, 3) with their colours in a body's frame, and an environment, to whose frame `turn` leads."""

    lamps_m: Floats
    colours: Floats
    around: Environment | None
    turn: Floats = field(default_factory=lambda: np.eye(3))


def _parts(lights: Any) -> tuple[Lamps, Environment | str | None]:
    """Return the lamps and the environment of what lights a scene."""
    if lights is None:
        return Lamps(LAMPS_M, LAMP_COLOURS), None
    several = isinstance(lights, list | tuple) and any(isinstance(part, AS_THEY_ARE) for part in lights)
    parts = list(lights) if several else [lights]
    around = [part for part in parts if isinstance(part, str | Environment)]
    placed = [part for part in parts if not isinstance(part, str | Environment)]
    lamps = [part if isinstance(part, Lamps) else Lamps(part) for part in placed]
    if len(around) > 1 or len(lamps) > 1:
        finding = f"{len(around)} environments and {len(lamps)} sets of lamps"
        raise QueryError("lights", finding, "Give one of each at most.")
    return lamps[0] if lamps else Lamps(np.zeros((0, 3))), around[0] if around else None


def earlier_scene_lights(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Let a function that takes `lights` take lamps and an environment as it did before, with a warning."""

    @functools.wraps(function)
    def call(*arguments: Parameters.args, **keywords: Parameters.kwargs) -> Result:
        earlier: dict[str, Any] = {name: keywords.pop(name) for name in EARLIER if name in keywords}
        if not earlier:
            return function(*arguments, **keywords)
        message = f"use `lights` in place of {', '.join(earlier)}; the old names go with {REMOVED_IN}"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        positions, colours, environment = (earlier.get(name) for name in EARLIER)
        if positions is None and colours is not None:
            raise QueryError("lamps_m", "colours without lamps", "Give a place of each.")
        parts: list[Any] = [] if positions is None else [Lamps(positions, colours)]
        if environment is not None:
            parts.append(environment if isinstance(environment, str) else Environment.of(environment))
        keywords["lights"] = parts or None
        return function(*arguments, **keywords)

    return call


def _turned(radiance: Floats, turn: Floats) -> Floats:
    """Return a map (h, 2 h, 3) as a frame sees it whose axes are the columns of `turn` (3, 3)."""
    if np.array_equal(turn, np.eye(3)):
        return radiance
    from objectfolder.vision.compiled.surroundings import looked_up

    rows = len(radiance)
    directions = (pixel_directions(rows)[0] @ turn.T).reshape(-1, 3)
    finest = np.zeros(len(directions))
    texels = looked_up(radiance.reshape(-1, 3), np.array([rows]), directions, finest)
    return np.asarray(texels.reshape(radiance.shape))
