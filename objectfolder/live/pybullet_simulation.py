"""PyBullet as a running simulation."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.hertz import mass_at_contact
from objectfolder.errors import QueryError
from objectfolder.extras import needs_extra
from objectfolder.live.contacts import Touching

Floats = NDArray[np.float64]
BASE = -1  # PyBullet's number of a body's first link


class Motion(NamedTuple):
    """Centre of mass, axes of inertia as columns, and velocities of a link at the beginning of a step."""

    centre_m: Floats
    axes: Floats
    velocity_m_s: Floats
    spin_rad_s: Floats


class PybulletSimulation:
    """A PyBullet world; see `contacts.Simulation`.

    Parameters
    ----------
    client
        The number `pybullet.connect` returned.
    bodies
        Numbers that `pybullet.loadURDF` and its like returned, by names; others are named by number. The
        further links of a body are named by theirs, ``arm/2``. Joints are taken as loose in a collision.

    Raises
    ------
    MissingPackageError
        PyBullet is not installed.
    QueryError
        A number that is no body of the world.
    """

    def __init__(self, client: int, bodies: Mapping[str, int]) -> None:
        with needs_extra("pybullet"):
            import pybullet
        self._engine, self._client, self._steps = pybullet, client, 0
        numbers = [pybullet.getBodyUniqueId(n, client) for n in range(pybullet.getNumBodies(client))]
        for name, number in bodies.items():
            if number not in numbers:
                raise QueryError(
                    "bodies", f"{name!r} is no body of the world", "Give what `loadURDF` returned."
                )
        names = {number: str(number) for number in numbers} | {n: name for name, n in bodies.items()}
        self._links = {name: (number, BASE) for number, name in names.items()}
        for number, name in names.items():
            joints = range(pybullet.getNumJoints(number, client))
            self._links |= {f"{name}/{link}": (number, link) for link in joints}
        self._names = {link: name for name, link in self._links.items()}
        self._remember()

    @property
    def time_s(self) -> float:
        """Seconds that this adapter has moved the world on."""
        return self._steps * self.timestep_s

    @property
    def timestep_s(self) -> float:
        """Seconds a step."""
        return float(self._engine.getPhysicsEngineParameters(self._client)["fixedTimeStep"])

    def step(self) -> None:
        """Move the world on by a time step."""
        self._remember()
        self._engine.stepSimulation(self._client)
        self._steps += 1

    def pose(self, body: str) -> Floats:
        """Return the pose (4, 4) of a body, object to world, metres."""
        motion, (_, _, _, centre, quaternion, *_) = self._motions[self._link(body)], self._dynamics(body)
        pose = np.eye(4)
        pose[:3, :3] = motion.axes @ self._rotation(quaternion).T
        pose[:3, 3] = motion.centre_m - pose[:3, :3] @ centre
        return pose

    def mass_kg(self, body: str) -> float:
        """Return the mass of a body, 0 of one that cannot move.

        Raises
        ------
        QueryError
            No such body.
        """
        return float(self._dynamics(body)[0])

    def touching(self) -> list[Touching]:
        """Return the contacts that had a force in the last step."""
        touches = []
        for contact in self._engine.getContactPoints(physicsClientId=self._client):
            links, force_n = ((contact[1], contact[3]), (contact[2], contact[4])), float(contact[9])
            if force_n > 0:
                # PyBullet's normal is from the second body to the first.
                point, normal = np.array(contact[6]), -np.array(contact[7])
                motions = [self._motions[link] for link in links]
                at_point = [m.velocity_m_s + np.cross(m.spin_rad_s, point - m.centre_m) for m in motions]
                names = self._names[links[0]], self._names[links[1]]
                # As told, of the first body.
                along = -contact[10] * np.array(contact[11]) - contact[12] * np.array(contact[13])
                depth_m = max(0.0, -contact[8])
                touches.append(Touching(names, point, normal, force_n, np.stack(at_point), along, depth_m))
        return touches

    def mass_at_kg(self, touching: Touching) -> float:
        """Return the mass that two bodies offer to each other at a contact along its normal."""
        mobility = 0.0
        for body in touching.bodies:
            mass, _, moments = self._dynamics(body)[:3]
            if mass > 0:
                centre, axes = self._motions[self._link(body)][:2]
                point, normal = (touching.point_m - centre) @ axes, touching.normal @ axes
                mobility += 1 / mass_at_contact(
                    mass,
                    inertia_kg_m2=np.diag(moments),
                    centre_of_mass_m=np.zeros(3),
                    point_m=point,
                    normal=normal,
                )
        return 1 / mobility if mobility > 0 else np.inf

    def _link(self, body: str) -> tuple[int, int]:
        try:
            return self._links[body]
        except KeyError as error:
            raise QueryError("files", f"no body {body!r} in the simulation", "Name its bodies.") from error

    def _dynamics(self, body: str) -> tuple[Any, ...]:
        """Mass, friction, principal moments, and centre and quaternion of inertia in the body's frame."""
        return tuple(self._engine.getDynamicsInfo(*self._link(body), self._client))

    def _rotation(self, quaternion: Any) -> Floats:
        return np.array(self._engine.getMatrixFromQuaternion(quaternion)).reshape(3, 3)

    def _remember(self) -> None:
        """Keep how all bodies move: contacts of a step are at its beginning."""
        self._motions = {link: self._motion(*link) for link in self._names}

    def _motion(self, number: int, link: int) -> Motion:
        if link == BASE:
            centre, quaternion = self._engine.getBasePositionAndOrientation(number, self._client)
            velocity, spin = self._engine.getBaseVelocity(number, self._client)
        else:
            state = self._engine.getLinkState(number, link, 1, 1, self._client)
            centre, quaternion, velocity, spin = state[0], state[1], state[6], state[7]
        return Motion(np.array(centre), self._rotation(quaternion), np.array(velocity), np.array(spin))
