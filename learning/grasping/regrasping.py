"""An environment of Gymnasium: close on an object that is not seen, feel it, and grasp again or lift.

The object is put back before it is grasped again, so that what an attempt comes to hangs on where the fingers
close alone. The force is the same throughout: nothing is won by squeezing.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils.seeding import np_random
from numpy.typing import NDArray
from skimage.transform import resize_local_mean

from learning.grasping.world import HEIGHT_SHARE, HELD_SHARE, YAW_RAD, Grasp, World
from objectfolder.errors import QueryError
from objectfolder.live import Felt
from objectfolder.live.gripper import FINGERS

Floats = NDArray[np.float32]
POOLED = 8, 6  # rows and columns that fields over a gel are averaged to
# Numbers of each part that a gel may show: how deep it is pressed in, the force on it, how far it is sheared.
GEL_SIZES = {"depth": POOLED[0] * POOLED[1], "force": 3, "shear": 2 * POOLED[0] * POOLED[1]}
WITHOUT_GELS = 1 + 3 + 1  # numbers of an observation
# A move by 1 of an action: along the fingers' breadth, of the object's yaw, of the height.
MOVE = np.array([0.04, 0.25, 0.3])  # metres, radians, halves of the object's height between the fingers
DEPTH_M, FORCE_N, SHEAR_M, OPENING_M = 1e-4, 5.0, 1e-4, 0.1  # what an observation counts as 1
FARTHEST = np.array([0.1, 0.75, 0.8])  # from the centre of mass, as `MOVE`


class Regrasping(gymnasium.Env[Floats, Floats]):
    """Grasps of one of several objects, drawn by episode.

    An observation (n,) is what both gels show: of each those of `POOLED` mean depths, the force (3,) in its
    sensor's frame, and `POOLED` mean displacements along it, across and down, that are asked for. Then
    (`WITHOUT_GELS`,): how far the gels are apart, what has been moved since the first grasp, the share of the
    regrasps that is left. An action (4,) in [-1, 1] is a move, see `MOVE`. Above 0 in its last place the
    fingers lift instead. After the last regrasp they lift in any case. Only lifting ends an episode. It is
    rewarded by 1 where the object is held; each regrasp is charged for.

    A gel whose press cannot be solved shows its force alone, as where a collision part stands off the
    surface: other numbers are 0. Where an object lies deeper in a gel than that gives way, as a heavy one
    squeezed hard, all numbers of both gels are 0. ``unseen`` of what is said beside an observation counts
    the gels of either kind in the episode.

    Parameters
    ----------
    worlds
        By the names of objects.
    forces_n
        Of each finger, by the same names.
    spread_m
        First grasps are off the centre of mass by as much at most.
    regrasps
        At most, in an episode.
    charge
        Of a regrasp.
    observation
        What gels show, of `GEL_SIZES`.

    Attributes
    ----------
    ids
        Of the objects, in order.
    place
        (3,) of the fingers from the centre of mass, as `MOVE`.
    grasp
        The same as the world has it.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  (gymnasium declares it so)

    def __init__(
        self,
        worlds: Mapping[str, World],
        forces_n: Mapping[str, float],
        spread_m: float,
        regrasps: int,
        charge: float,
        observation: Sequence[str] = ("depth", "force"),
    ) -> None:
        self._worlds, self._forces_n, self.ids = worlds, dict(forces_n), sorted(worlds)
        self._spread_m, self._most, self._charge = spread_m, regrasps, charge
        self._shown = [part for part in GEL_SIZES if part in observation]
        self._gel_size = sum(GEL_SIZES[part] for part in self._shown)
        size = 2 * self._gel_size + WITHOUT_GELS
        self.observation_space = Box(-np.inf, np.inf, (size,), np.float32)
        self.action_space = Box(-1.0, 1.0, (4,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Draw an object and where it is grasped first, and close the fingers there."""
        super().reset(seed=seed)
        self._object_id = self._drawn_object(self.np_random)
        self._back_rad = self.np_random.choice([0.0, np.pi])
        spread = np.array([self._spread_m, YAW_RAD, HEIGHT_SHARE])
        self._first = self.place = self.np_random.uniform(-spread, spread)
        self._regrasps = self._unseen = 0
        self._close()
        return self._seen, self._info()

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Grasp again elsewhere, or lift."""
        charged, lifts = 0.0, bool(action[3] > 0)
        if not lifts:
            self.place = np.clip(self.place + MOVE * action[:3], -FARTHEST, FARTHEST)
            self._regrasps += 1
            self._close()
            charged, lifts = self._charge, self._regrasps == self._most
        if not lifts:
            return self._seen, -charged, False, False, self._info()
        held = self._worlds[self._object_id].lift(self._force_n) >= HELD_SHARE
        return self._seen, float(held) - charged, True, False, self._info() | {"is_success": held}

    def object_of(self, seed: int) -> str:
        """Return the object that an episode of this seed has."""
        return self._drawn_object(np_random(seed)[0])

    def _drawn_object(self, random: np.random.Generator) -> str:
        return str(random.choice(self.ids))

    @property
    def _force_n(self) -> float:
        return self._forces_n[self._object_id]

    def _close(self) -> None:
        offset_m, yaw_rad, height_share = self.place
        self.grasp = Grasp(yaw_rad + self._back_rad, offset_m, height_share, self._force_n)
        self._worlds[self._object_id].close(self.grasp)
        self._seen = self._observed()

    def _info(self) -> dict[str, Any]:
        return {
            "object": self._object_id,
            "place": self.place.copy(),
            "regrasps": self._regrasps,
            "unseen": self._unseen,
        }

    def _observed(self) -> Floats:
        world = self._worlds[self._object_id]
        moved = (self.place - self._first) / MOVE
        remaining = 1 - self._regrasps / self._most
        try:
            gels = [self._gel_features(felt) for felt in world.feel().values()]
        except QueryError:
            self._unseen += len(FINGERS)
            gels = [np.zeros(self._gel_size, dtype=np.float32) for _ in FINGERS]
        return np.hstack([*gels, world.opening_m / OPENING_M, moved, remaining]).astype(np.float32)

    def _gel_features(self, felt: Felt) -> Floats:
        """Return what a gel shows, as numbers about 1."""
        features = {
            "depth": lambda: _averaged(felt.pressed.displacement_m) / DEPTH_M,
            "force": lambda: felt.force_n / FORCE_N,
            "shear": lambda: np.hstack([_averaged(way) for way in felt.sheared[1].displacement_m]) / SHEAR_M,
        }
        parts, solved = [], True
        for part in self._shown:
            try:
                parts.append(features[part]())
            except QueryError:
                solved = False
                parts.append(np.zeros(GEL_SIZES[part]))
        self._unseen += not solved
        return np.hstack(parts).astype(np.float32)


def _averaged(field_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(resize_local_mean(field_m, POOLED)).ravel()
