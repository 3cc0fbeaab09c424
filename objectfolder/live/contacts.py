"""What a running simulation tells of its bodies: poses, masses and contacts, and nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Touching:
    """Two bodies that touch at a point.

    Attributes
    ----------
    bodies : names of the two
    point_m : (3,) in the world
    normal : (3,) unit, from the first body to the second
    approach_m_s : speed at which they close along the normal, before the contact slowed them; negative apart
    mass_kg : that the two offer to each other there along the normal (Mirtich 1996, section 3.2)
    """

    bodies: tuple[str, str]
    point_m: Floats
    normal: Floats
    approach_m_s: float
    mass_kg: float


class Simulation(Protocol):
    """An engine of rigid bodies with objects in it; `MujocoSimulation` is one."""

    @property
    def time_s(self) -> float:
        """Seconds since the engine's start."""

    @property
    def timestep_s(self) -> float:
        """Seconds a step."""

    def step(self) -> None:
        """Move the world on by a time step."""

    def pose(self, body: str) -> Floats:
        """Return the pose (4, 4) of a body at the beginning of the last step, object to world, metres."""

    def mass_kg(self, body: str) -> float:
        """Return the mass of a body."""

    def touching(self) -> Sequence[Touching]:
        """Return the contacts at the beginning of the last step."""
