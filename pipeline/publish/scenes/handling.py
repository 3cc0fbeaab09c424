"""A scene of MuJoCo in one's hands: a pointer that finds and carries, and two fingers that squeeze."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import QueryError
from objectfolder.extras import needs_extra
from objectfolder.live.contacts import finite_pose
from objectfolder.live.gripper import FINGERS, MOTORS, OPENING_M, fingers
from objectfolder.live.mujoco_simulation import MujocoSimulation
from objectfolder.live.rubbing import GRAVITY_M_S2
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.object_file.shared_sensor import shared_sensor
from objectfolder.query_values import real, real_array
from objectfolder.touch.sensor.sensor import Sensor

Floats = NDArray[np.float64]
HAND = "hand/"  # before the names of its bodies and joints
FELT_BY = tuple(HAND + name for name in FINGERS)
FRICTION, GREATEST_FORCE_N = 0.8, 10.0  # of the fingers
STARTS_M, PARKED_M = 0.3, (0.0, 0.0, 5.0)  # of fingers from the middle of the hand; of a hand not in use
# What is carried hangs on a critically damped spring, and its turning dies away as fast.
CARRYING_RAD_S = 15.0


@dataclass(frozen=True)
class Found:
    """A place on a body: where (3,) in its frame, and its normal (3,) in the world, on the side seen."""

    body: str
    local_m: Floats
    normal: Floats


class Handling(MujocoSimulation):
    """A scene of MuJoCo that one has in one's hands.

    Parameters
    ----------
    spec
        `mujoco.MjSpec` of the scene, which gets a hand that nothing but objects stops, and elliptic cones.
    files
        Object Files by the names of their bodies, which move freely.
    sensor
        Of both fingers; the one that the files were made with if None.

    Raises
    ------
    QueryError
        A body that the scene lacks or holds fast, no sensor where the files were made with different ones.
    """

    def __init__(self, spec: Any, files: Mapping[str, ObjectFile], sensor: Sensor | None = None) -> None:
        with needs_extra("mujoco"):
            import mujoco
        self.sensor = sensor or shared_sensor(files)
        away = 0.0, -self.sensor.gel_apex_m[2]
        pair = fingers(away, (-STARTS_M, STARTS_M), self.sensor, FRICTION)
        palm = f'<body name="palm" mocap="true" pos="{" ".join(map(str, PARKED_M))}">{pair}</body>'
        hand = f"<mujoco><worldbody>{palm}</worldbody><actuator>{MOTORS}</actuator></mujoco>"
        spec.attach(mujoco.MjSpec.from_string(hand), frame=spec.worldbody.add_frame(), prefix=HAND)
        for name in FELT_BY:
            spec.add_exclude(bodyname1="world", bodyname2=name)
        spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0
        model = spec.compile()
        super().__init__(model, mujoco.MjData(model))
        self._files = dict(files)
        self._free = {name: self._place_of(name) for name in files}
        self._carried: tuple[str, Floats, Floats] | None = None

    def step(self) -> None:
        """Move the world on by a time step, with what is carried; raises as `MujocoSimulation.step`."""
        self._data.xfrc_applied[:] = 0.0
        if self._carried:
            self._pull(*self._carried)
        super().step()

    def reset(self) -> None:
        """Return everything to its place, the hand included."""
        self._engine.mj_resetData(self._model, self._data)
        self._engine.mj_forward(self._model, self._data)
        self._carried = None

    def under(self, origin: Floats, direction: Floats) -> Found | None:
        """Return what a ray from (3,) along (3,) meets first, by the surfaces of the Object Files."""
        origin, direction = real_array("origin", origin), real_array("direction", direction)
        hit, nearest = None, np.inf
        for name, file in self._files.items():
            pose = finite_pose(self, name)
            turn = pose[:3, :3]
            hits = file.surface.ray_hits(((origin - pose[:3, 3]) @ turn)[None], (direction @ turn)[None])
            if hits.face[0] >= 0 and hits.distance[0] < nearest:
                nearest = float(hits.distance[0])
                normal = turn @ file.surface.normals_at(hits.face, hits.barycentric)[0]
                local = file.surface.points_at(hits.face, hits.barycentric)[0]
                hit = Found(name, local, -normal if normal @ direction > 0 else normal)
        return hit

    def where(self, body: str, local_m: Floats) -> Floats:
        """Return where (3,) in the world a point of a body is."""
        pose = finite_pose(self, body)
        return np.asarray(pose[:3, :3] @ local_m + pose[:3, 3])

    def carry(self, body: str, local_m: Floats, target_m: Floats) -> None:
        """Draw a point (3,) of a body to one of the world, from now until `let_go`: it hangs on a spring."""
        self._carried = body, real_array("local_m", local_m), real_array("target_m", target_m)

    def let_go(self) -> None:
        """Leave what is carried to its speed."""
        self._carried = None

    def lift(self, body: str, height_m: float) -> None:
        """Put a body at rest over the place where it stood in the scene, as it stood there."""
        place, speed = self._free[body]
        self._data.qpos[place : place + 7] = self._model.qpos0[place : place + 7]
        self._data.qpos[place + 2] += real("height_m", height_m, 0.0, 10.0, " m")
        self._data.qvel[speed : speed + 6] = 0.0
        self._engine.mj_forward(self._model, self._data)

    def reach_round(self, body: str, across: Floats) -> None:
        """Open the fingers on both sides of a body, in a level direction (3,), at the middle of its height.

        Raises
        ------
        QueryError
            A body wider than the hand, a direction that is not level.
        """
        pose, y = finite_pose(self, body), real_array("across", across) * [1.0, 1.0, 0.0]
        if not np.linalg.norm(y) > 0:
            raise QueryError("across", "not level", "Give a direction in the plane of the table.")
        y = y / np.linalg.norm(y)
        frame = np.column_stack([np.cross(y, [0.0, 0.0, 1.0]), y, [0.0, 0.0, 1.0]])
        corners = (self._files[body].surface.vertices @ pose[:3, :3].T + pose[:3, 3]) @ frame
        low, high = corners.min(axis=0), corners.max(axis=0)
        travel_m = STARTS_M - (high[1] - low[1]) / 2 - OPENING_M - self.sensor.gel_apex_m[0]
        if travel_m < 0:
            raise QueryError(body, f"{high[1] - low[1]:.3g} m wide, wider than the hand", "Turn it.")
        turn = np.zeros(4)
        self._engine.mju_mat2Quat(turn, frame.ravel())
        self._data.mocap_pos[-1], self._data.mocap_quat[-1] = frame @ ((low + high) / 2), turn
        self._data.ctrl[-4:], self._data.act[-2:] = 0.0, 0.0
        for name in FELT_BY:
            for way, place in (("close", travel_m), ("lift", 0.0)):
                joint = self._data.joint(f"{name}_{way}")
                joint.qpos[0], joint.qvel[0] = place, 0.0
        self._engine.mj_forward(self._model, self._data)

    def grip(self, force_n: float, lifting_m_s: float) -> None:
        """Close both fingers with a force, and lift them at a speed, by up to 20 cm."""
        force = real("force_n", force_n, -GREATEST_FORCE_N, GREATEST_FORCE_N, " N")
        speed = real("lifting_m_s", lifting_m_s, -0.5, 0.5, " m/s")
        self._data.ctrl[-4:] = [force, force, speed, speed]

    def park(self) -> None:
        """Take the hand away."""
        self._data.mocap_pos[-1], self._data.ctrl[-4:] = PARKED_M, 0.0
        self._engine.mj_forward(self._model, self._data)

    def _place_of(self, name: str) -> tuple[int, int]:
        """Where a free body's pose and speed lie in those of all."""
        body = self._number(name)
        joint = self._model.body_jntadr[body]
        if joint < 0 or self._model.jnt_type[joint] != self._engine.mjtJoint.mjJNT_FREE:
            raise QueryError(name, "does not move freely in the scene", "Give it a free joint.")
        return int(self._model.jnt_qposadr[joint]), int(self._model.jnt_dofadr[joint])

    def _pull(self, name: str, local_m: Floats, target_m: Floats) -> None:
        body, at = self._number(name), self.where(name, local_m)
        mass, velocity = self.mass_kg(name), self._jacobian(body, at) @ self._data.qvel
        force = CARRYING_RAD_S * (CARRYING_RAD_S * (target_m - at) - 2 * velocity) * mass
        force[2] += GRAVITY_M_S2 * mass
        inertia = float(self._model.body_inertia[body].max())
        torque = np.cross(at - self._data.xipos[body], force)
        torque -= 2 * CARRYING_RAD_S * inertia * self._data.cvel[body, :3]
        self._data.xfrc_applied[body] = [*force, *torque]
