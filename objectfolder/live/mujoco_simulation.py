"""MuJoCo as a running simulation."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import QueryError
from objectfolder.live.contacts import Touching

Floats = NDArray[np.float64]


class MujocoSimulation:
    """A compiled MuJoCo model with its state; see `contacts.Simulation`.

    Parameters
    ----------
    model, data
        `mujoco.MjModel` and `mujoco.MjData`. Bodies are named as in the model, nameless ones by
        number; ``world`` is the ground.
    """

    def __init__(self, model: Any, data: Any) -> None:
        import mujoco

        mujoco.mj_forward(model, data)  # poses of a state that was just set
        self._model, self._data = model, data
        self._velocity = data.qvel.copy()

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
        import mujoco

        self._velocity = self._data.qvel.copy()
        mujoco.mj_step(self._model, self._data)
        bad = (
            mujoco.mjtWarning.mjWARN_BADQPOS,
            mujoco.mjtWarning.mjWARN_BADQVEL,
            mujoco.mjtWarning.mjWARN_BADQACC,
        )
        if any(self._data.warning[kind].number for kind in bad):
            raise QueryError("simulation", "poses or speeds that are not finite", "Take a smaller time step.")

    def pose(self, body: str) -> Floats:
        """Return the pose (4, 4) of a body, object to world, metres."""
        found, pose = self._data.body(body), np.eye(4)
        pose[:3, :3], pose[:3, 3] = found.xmat.reshape(3, 3), found.xpos
        return pose

    def mass_kg(self, body: str) -> float:
        """Return the mass of a body.

        Raises
        ------
        QueryError
            No such body.
        """
        try:
            return float(self._model.body(body).mass[0])
        except KeyError as error:
            raise QueryError("files", f"no body {body!r} in the simulation", "Name its bodies.") from error

    def touching(self) -> list[Touching]:
        """Return the contacts that had a force in the last step, of bodies of which one can move."""
        found = []
        for contact in self._data.contact:
            if contact.efc_address < 0:
                continue
            owners = [int(self._model.geom_bodyid[geom]) for geom in contact.geom]
            normal = contact.frame[:3].copy()
            along = normal @ (self._jacobian(owners[1], contact.pos) - self._jacobian(owners[0], contact.pos))
            mobility = float(along @ self._accelerated(along))
            if mobility > 0:
                first, second = (self._model.body(owner).name or str(owner) for owner in owners)
                speed = -float(along @ self._velocity)
                found.append(Touching((first, second), contact.pos.copy(), normal, speed, 1 / mobility))
        return found

    def _jacobian(self, body: int, point: Floats) -> Floats:
        """Return (3, speeds): the velocity of a point of a body for each of the model's speeds."""
        import mujoco

        jacobian = np.zeros((3, self._model.nv))
        mujoco.mj_jac(self._model, self._data, jacobian, None, point, body)
        return jacobian

    def _accelerated(self, force: Floats) -> Floats:
        """Return a generalised force (speeds,) over the masses of the model."""
        import mujoco

        result = np.zeros((1, self._model.nv))
        mujoco.mj_solveM(self._model, self._data, result, force[None])
        return result[0]
