"""What a running simulation tells of its bodies: poses, masses and contacts, and nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import QueryError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Touching:
    """Two bodies that touch at a point, at the beginning of a step.

    Attributes
    ----------
    bodies : names of the two
    point_m : (3,) in the world
    normal : (3,) unit, from the first body to the second
    force_n : along the normal during the step, not negative
    velocities_m_s : (2, 3) of the matter of both bodies there, before the contact changed them
    friction_n : (3,) force along the surface on the second body, in the world; 0 where an engine tells none
    depth_m : how far the engine's shapes lie in each other, not negative; 0 where an engine tells none

    Examples
    --------
    >>> import numpy as np
    >>> up, down = np.array([0.0, 0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [0.3, 0.0, -1.0]])
    >>> touching = Touching(("table", "mug"), np.zeros(3), up, 2.0, down)
    >>> touching.approach_m_s, touching.sliding_m_s.tolist()
    (1.0, [0.3, 0.0, 0.0])
    """

    bodies: tuple[str, str]
    point_m: Floats
    normal: Floats
    force_n: float
    velocities_m_s: Floats
    friction_n: Floats = field(default_factory=lambda: np.zeros(3))
    depth_m: float = 0.0

    @property
    def approach_m_s(self) -> float:
        """Speed at which the two close along the normal; negative apart."""
        return float(self.normal @ (self.velocities_m_s[0] - self.velocities_m_s[1]))

    @property
    def sliding_m_s(self) -> Floats:
        """Velocity (3,) of the second body over the first, without what closes them."""
        return self.velocities_m_s[1] - self.velocities_m_s[0] + self.approach_m_s * self.normal


class Posed(Protocol):
    """Bodies that are somewhere."""

    def pose(self, body: str) -> Floats:
        """Return the pose (4, 4) of a body at the beginning of the last step, object to world, metres."""


class Simulation(Posed, Protocol):
    """An engine of rigid bodies with objects in it: `MujocoSimulation`, `PybulletSimulation`, a plugin's."""

    @property
    def time_s(self) -> float:
        """Seconds since the engine's start."""

    @property
    def timestep_s(self) -> float:
        """Seconds a step."""

    def step(self) -> None:
        """Move the world on by a time step."""

    def mass_kg(self, body: str) -> float:
        """Return the mass of a body."""

    def touching(self) -> Sequence[Touching]:
        """Return the contacts of the last step."""

    def mass_at_kg(self, touching: Touching) -> float:
        """Return the mass that two bodies offer to each other along the normal of a contact of the last step.

        B. Mirtich, PhD thesis, Berkeley 1996, section 3.2; infinite where none can move.
        """


def finite_pose(simulation: Posed, body: str) -> Floats:
    """Return the pose (4, 4) of a body.

    Raises
    ------
    QueryError
        No such body, or a pose that is not finite.
    """
    pose = simulation.pose(body)
    if not np.isfinite(pose).all():
        raise QueryError("simulation", f"the pose of {body!r} is not finite", "Take a smaller time step.")
    return pose
