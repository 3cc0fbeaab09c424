"""Worlds of MuJoCo, one after the other, by the names that MuJoCo Warp and Warp have for theirs.

These two take 390 MB, and are not among what tests install.
"""

from copy import copy
from typing import Any

import mujoco
import numpy as np
import torch


class Worlds:
    """What `mujoco_warp.Data` has of many worlds."""

    def __init__(self, data: mujoco.MjData, count: int) -> None:
        self.single = [copy(data) for _ in range(count)]

    @property
    def xpos(self) -> np.ndarray:
        """Positions of bodies (worlds, bodies, 3)."""
        return np.stack([world.xpos for world in self.single])

    @property
    def xmat(self) -> np.ndarray:
        """Rotations of bodies (worlds, bodies, 3, 3)."""
        return np.stack([world.xmat.reshape(-1, 3, 3) for world in self.single])


def put_model(model: mujoco.MjModel) -> mujoco.MjModel:
    return model


def put_data(model: mujoco.MjModel, data: mujoco.MjData, *, nworld: int) -> Worlds:
    return Worlds(data, nworld)


def step(model: mujoco.MjModel, worlds: Worlds) -> None:
    for world in worlds.single:
        mujoco.mj_step(model, world)


def to_torch(array: Any) -> torch.Tensor:
    return torch.from_numpy(array)
