"""MuJoCo as a running simulation."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import QueryError
from objectfolder.extras import needs_extra
from objectfolder.live.contacts import Touching
from objectfolder.query_values import real_array

Floats = NDArray[np.float64]


class MujocoSimulation:
    """A compiled MuJoCo model with its state; see `contacts.Simulation`.

    Parameters
    ----------
    model, data
        `mujoco.MjModel` and `mujoco.MjData`. Bodies are named as in the model, nameless ones by
        number; ``world`` is the ground.

    Raises
    ------
    MissingPackageError
        MuJoCo is not installed.
    """

    def __init__(self, model: Any, data: Any) -> None:
        with needs_extra("mujoco"):
            import mujoco
        mujoco.mj_forward(model, data)  # poses of a state that was just set
        self._engine, self._model, self._data = mujoco, model, data
        kinds = mujoco.mjtWarning
        # Views of the engine's counts: looking these up takes a tenth of a small scene's step.
        self._bad = [
            data.warning[kind] for kind in (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
        ]
        self._names = [model.body(number).name or str(number) for number in range(model.nbody)]

    @property
    def time_s(self) -> float:
        """Seconds since `data.time` was 0."""
        return float(self._data.time)

    @property
    def timestep_s(self) -> float:
        """Seconds a step."""
        return float(self._model.opt.timestep)

    def step(self) -> None:
        """Move the world on by a time step.

        Raises
        ------
        QueryError
            The simulation has become unstable.
        """
        self._engine.mj_step(self._model, self._data)
        if any(warning.number for warning in self._bad):
            raise QueryError("simulation", "poses or speeds that are not finite", "Take a smaller time step.")

    def strike(self, body: str, point_m: Floats, impulse_n_s: Floats) -> None:
        """Change speeds at once by an impulse (3,) on a body at a point (3,) of the world.

        Raises
        ------
        QueryError
            No such body, values that are not finite.
        """
        point, impulse = real_array("point_m", point_m), real_array("impulse_n_s", impulse_n_s)
        change = np.zeros((1, self._model.nv))
        along = impulse @ self._jacobian(self._number(body), point)
        self._engine.mj_solveM(self._model, self._data, change, along[None])
        self._data.qvel += change[0]

    def pose(self, body: str) -> Floats:
        """Return the pose (4, 4) of a body, object to world, metres."""
        number, pose = self._number(body), np.eye(4)
        pose[:3, :3], pose[:3, 3] = self._data.xmat[number].reshape(3, 3), self._data.xpos[number]
        return pose

    def mass_kg(self, body: str) -> float:
        """Return the mass of a body.

        Raises
        ------
        QueryError
            No such body.
        """
        return float(self._model.body_mass[self._number(body)])

    def touching(self) -> list[Touching]:
        """Return the contacts that had a force in the last step."""
        contacts = self._data.contact
        which = np.flatnonzero(contacts.efc_address >= 0)
        owners, points = self._model.geom_bodyid[contacts.geom[which]], contacts.pos[which]
        velocities, frames = self._velocities(owners, points), contacts.frame[which]
        forces = np.zeros((len(which), 6))
        for index, force in zip(which, forces, strict=True):
            self._engine.mj_contactForce(self._model, self._data, index, force)
        along = forces[:, 1:2] * frames[:, 3:6] + forces[:, 2:3] * frames[:, 6:]
        pressed_n = np.maximum(0.0, forces[:, 0]).tolist()
        depths_m = np.maximum(0.0, -contacts.dist[which]).tolist()
        names = [(self._names[first], self._names[second]) for first, second in owners.tolist()]
        rows = zip(names, points, frames[:, :3], pressed_n, velocities, along, depths_m, strict=True)
        return [Touching(*row) for row in rows]

    def mass_at_kg(self, touching: Touching) -> float:
        """Return the mass that two bodies offer to each other at a contact, joints included."""
        first, second = (self._jacobian(self._number(body), touching.point_m) for body in touching.bodies)
        along, accelerated = touching.normal @ (second - first), np.zeros((1, self._model.nv))
        self._engine.mj_solveM(self._model, self._data, accelerated, along[None])
        mobility = float(along @ accelerated[0])
        return 1 / mobility if mobility > 0 else np.inf

    def _number(self, body: str) -> int:
        try:
            return self._names.index(body)
        except ValueError as error:
            raise QueryError("files", f"no body {body!r} in the simulation", "Name its bodies.") from error

    def _velocities(self, owners: NDArray[np.int32], points: Floats) -> Floats:
        """Return the velocities (n, 2, 3) of pairs of bodies (n, 2) at points (n, 3), before the step."""
        twists = self._data.cvel[owners]  # turning and moving at the centre of a tree of bodies
        x = points[:, None] - self._data.subtree_com[self._model.body_rootid[owners]]
        spin = twists[:, :, :3]
        turned = spin[..., [1, 2, 0]] * x[..., [2, 0, 1]] - spin[..., [2, 0, 1]] * x[..., [1, 2, 0]]
        return np.asarray(twists[:, :, 3:] + turned)

    def _jacobian(self, body: int, point: Floats) -> Floats:
        """Return (3, speeds): the velocity of a point of a body for each of the model's speeds."""
        jacobian = np.zeros((3, self._model.nv))
        self._engine.mj_jac(self._model, self._data, jacobian, None, point, body)
        return jacobian
