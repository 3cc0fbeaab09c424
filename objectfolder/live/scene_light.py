"""What lights a scene: lamps in the world, and light from all round."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import QueryError
from objectfolder.live.scene_view import inverse_pose, moved_by
from objectfolder.query_values import real_array
from objectfolder.vision.environment import Environment, named_map, pixel_directions

Floats = NDArray[np.float64]
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
    """

    lamps_m: Floats
    colours: Floats
    radiance: Floats | None = None
    above: Floats = field(default_factory=lambda: np.zeros(3))
    towards: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    shares: Floats = field(default_factory=lambda: np.zeros((0, 3)))

    @classmethod
    def of(cls, lamps_m: Any, lamp_colours: Any, environment: Any) -> "SceneLight":
        """Return the light of a scene; None everywhere stands for `LAMPS_M`, beside an environment for none.

        Raises
        ------
        QueryError
            Lamps or colours of other shapes, another environment than `ObjectFile.render` knows.
        """
        if lamps_m is None and lamp_colours is None:
            lamps_m, lamp_colours = (LAMPS_M, LAMP_COLOURS) if environment is None else np.zeros((2, 0, 3))
        lamps, colours = real_array("lamps_m", lamps_m), real_array("lamp_colours", lamp_colours)
        if lamps.ndim != 2 or lamps.shape[1:] != (3,) or colours.shape != lamps.shape:
            finding = f"{lamps.shape} and {colours.shape}"
            raise QueryError("lamps_m, lamp_colours", finding, "Give a place and a colour (3,) of each.")
        if environment is None:
            return cls(lamps, colours)
        known = Environment.of(environment)  # or it is refused
        radiance = named_map(environment) if isinstance(environment, str) else np.asarray(environment, float)
        rows = len(radiance)
        edges = np.maximum(np.cos(np.pi * np.arange(rows + 1) / rows), 0.0)
        arriving = (edges[:-1] ** 2 - edges[1:] ** 2) / (2 * rows)  # cosine times solid angle, over pi
        above = np.tensordot(arriving, radiance.sum(axis=1), 1)
        up = known.directions[:, 2] > 0
        shares = known.powers[up] * known.directions[up, 2:]
        shares *= above / np.maximum(shares.sum(axis=0), 1e-300)
        return cls(lamps, colours, radiance, above, known.directions[up], shares)

    def seen_by(self, pose: Floats, unit_m: float) -> "SceneLight":
        """Return the light in a body's frame, whose lamps are as strong at `unit_m` as these at a metre."""
        radiance = None if self.radiance is None else _turned(self.radiance, pose[:3, :3])
        lamps = moved_by(inverse_pose(pose), self.lamps_m)
        return SceneLight(lamps, self.colours / unit_m**2, radiance, self.above)


def _turned(radiance: Floats, turn: Floats) -> Floats:
    """Return a map (h, 2 h, 3) as a frame sees it whose axes are the columns of `turn` (3, 3)."""
    if np.array_equal(turn, np.eye(3)):
        return radiance
    from objectfolder.vision.compiled.surroundings import looked_up

    rows = len(radiance)
    directions = (pixel_directions(rows)[0] @ turn.T).reshape(-1, 3)
    finest = np.zeros(len(directions))
    seen = looked_up(radiance.reshape(-1, 3), np.array([rows]), directions, finest)
    return np.asarray(seen.reshape(radiance.shape))
