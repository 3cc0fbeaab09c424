"""Assets in the simulators themselves: what each reads, and whether a body rests, slides and turns in it.

An engine that is not installed is left out by `ENGINES`. All read the files of one asset's folder.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.simulators.formats import FORMATS

GRAVITY = 9.81
SETTLE_S = 4.0


@dataclass(frozen=True)
class Read:
    """Mass in kilograms, centre of mass (3,) in metres, ascending principal moments (3,) in kg m2."""

    mass_kg: float
    centre_m: np.ndarray
    moments: np.ndarray

    def worst_relative(self, body: Any, length_m: float) -> float:
        """Return the largest error against a `RigidBody`: of the centre as a share of the length."""
        moments = body.principal()[0]
        return max(
            abs(self.mass_kg / body.mass_kg - 1),
            float(np.abs(self.centre_m - body.centre_of_mass_m).max()) / length_m,
            float(np.abs(np.sort(self.moments) / moments - 1).max()),
        )


def _file(folder: Path, kind: str) -> str:
    return str(folder / FORMATS[kind][0])


def read_mujoco(folder: Path, kind: str) -> Read:
    import mujoco

    model = mujoco.MjModel.from_xml_path(_file(folder, kind))
    return Read(float(model.body_mass[1]), model.body_ipos[1].copy(), model.body_inertia[1].copy())


def read_pybullet(folder: Path, kind: str) -> Read:
    import pybullet

    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(
            _file(folder, kind), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
        )
        dynamics = pybullet.getDynamicsInfo(body, -1, physicsClientId=client)
        return Read(dynamics[0], np.array(dynamics[3]), np.array(dynamics[2]))
    finally:
        pybullet.disconnect(client)


def read_drake(folder: Path, kind: str) -> Read:
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(0.001)
    (model,) = Parser(plant).AddModels(_file(folder, kind))
    (index,) = plant.GetBodyIndices(model)
    inertia = plant.get_body(index).default_spatial_inertia()
    centre = inertia.get_com()
    about = inertia.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
    return Read(inertia.get_mass(), centre, np.linalg.eigvalsh(about))


def read_sapien(folder: Path, kind: str) -> Read:
    import sapien

    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    loader = scene.create_urdf_loader()
    articulations, actors = loader.parse(_file(folder, kind))[:2]
    (builder,) = [*articulations, *actors]
    # Without a rendering device what it looks like cannot be built.
    builder.visual_records.clear()
    body = builder.build().find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
    return Read(body.mass, np.array(body.cmass_local_pose.p), np.array(body.inertia))


def read_usd(folder: Path, kind: str) -> Read:
    from pxr import Usd, UsdPhysics

    stage = Usd.Stage.Open(_file(folder, kind))
    mass = UsdPhysics.MassAPI(stage.GetDefaultPrim())
    hulls = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.MeshCollisionAPI)]
    if not hulls or not stage.GetDefaultPrim().HasAPI(UsdPhysics.RigidBodyAPI):
        raise ValueError("no rigid body with collision meshes")
    return Read(
        mass.GetMassAttr().Get(),
        np.array(mass.GetCenterOfMassAttr().Get()),
        np.array(mass.GetDiagonalInertiaAttr().Get()),
    )


ENGINES: dict[str, tuple[Callable[[Path, str], Read], tuple[str, ...]]] = {
    engine: (read, kinds)
    for module, engine, read, kinds in (
        ("mujoco", "MuJoCo", read_mujoco, ("mjcf", "urdf")),
        ("pybullet", "PyBullet", read_pybullet, ("urdf",)),
        ("pydrake", "Drake", read_drake, ("mjcf", "urdf", "sdf")),
        ("sapien", "SAPIEN", read_sapien, ("urdf",)),
        ("pxr", "usd-core", read_usd, ("usd",)),
    )
    if find_spec(module)
}


@dataclass(frozen=True)
class Rest:
    """What a body did in four seconds on a plane, started in a pose at rest.

    Metres, degrees, metres or radians a second, metres; and the final pose (4, 4).
    """

    moved_m: float
    tilted_deg: float
    speed: float
    overlap_m: float
    pose: np.ndarray


def rest_in_mujoco(folder: Path, pose: np.ndarray, time_s: float = SETTLE_S) -> Rest:
    import mujoco

    spec = _on_a_plane(folder, pose)
    model = spec.compile()
    data = mujoco.MjData(model)
    overlap = 0.0
    while data.time < time_s:
        mujoco.mj_step(model, data)
    overlap = max([0.0, *(-contact.dist for contact in data.contact)])
    end = np.eye(4)
    end[:3, :3], end[:3, 3] = data.xmat[1].reshape(3, 3), data.xpos[1]
    return _rest(folder, pose, end, float(np.abs(data.qvel).max()), overlap)


def rest_in_pybullet(folder: Path, pose: np.ndarray, time_s: float = SETTLE_S) -> Rest:
    import pybullet
    from scipy.spatial.transform import Rotation

    client = pybullet.connect(pybullet.DIRECT)
    try:
        ask = {"physicsClientId": client}
        pybullet.setGravity(0, 0, -GRAVITY, **ask)
        plane = pybullet.createMultiBody(0, pybullet.createCollisionShape(pybullet.GEOM_PLANE, **ask), **ask)
        pybullet.changeDynamics(plane, -1, lateralFriction=1.0, **ask)
        body = pybullet.loadURDF(_file(folder, "urdf"), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, **ask)
        local = np.array(pybullet.getDynamicsInfo(body, -1, **ask)[3])
        # The base's pose is that of its centre of mass and principal axes.
        turned = Rotation.from_quat(pybullet.getDynamicsInfo(body, -1, **ask)[4])
        start = Rotation.from_matrix(pose[:3, :3])
        at = pose[:3, :3] @ local + pose[:3, 3]
        pybullet.resetBasePositionAndOrientation(body, at, (start * turned).as_quat(), **ask)
        # By default it stops solving early, and bodies tremble at some milliradians a second.
        pybullet.setPhysicsEngineParameter(fixedTimeStep=0.002, solverResidualThreshold=0, **ask)
        for _ in range(round(time_s / 0.002)):
            pybullet.stepSimulation(**ask)
        place, quaternion = pybullet.getBasePositionAndOrientation(body, **ask)
        end = np.eye(4)
        end[:3, :3] = (Rotation.from_quat(quaternion) * turned.inv()).as_matrix()
        end[:3, 3] = np.array(place) - end[:3, :3] @ local
        speed = float(np.abs(pybullet.getBaseVelocity(body, **ask)).max())
        touching = pybullet.getContactPoints(body, plane, **ask)
        return _rest(folder, pose, end, speed, max([0.0, *(-contact[8] for contact in touching)]))
    finally:
        pybullet.disconnect(client)


def rest_in_drake(folder: Path, pose: np.ndarray, time_s: float = SETTLE_S) -> Rest:
    """Rigid hulls on a stiff compliant plane: point contact has one point a hull, on which all rock.

    By Drake's convex solver of contact; with its default one bodies tremble at up to .5 rad/s.
    """
    from pydrake.geometry import (
        AddCompliantHydroelasticPropertiesForHalfSpace,
        AddContactMaterial,
        HalfSpace,
        ProximityProperties,
        SceneGraphConfig,
    )
    from pydrake.math import RigidTransform, RotationMatrix
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import (
        AddMultibodyPlantSceneGraph,
        CoulombFriction,
        DiscreteContactApproximation,
    )
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder

    builder = DiagramBuilder()
    plant, scene = AddMultibodyPlantSceneGraph(builder, 0.002)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
    config = SceneGraphConfig()
    config.default_proximity_properties.compliance_type = "rigid"
    scene.set_config(config)
    (model,) = Parser(plant).AddModels(_file(folder, "urdf"))
    (index,) = plant.GetBodyIndices(model)
    body = plant.get_body(index)
    ground = ProximityProperties()
    AddContactMaterial(friction=CoulombFriction(1.0, 1.0), properties=ground)
    AddCompliantHydroelasticPropertiesForHalfSpace(0.01, 1e9, ground)
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "ground", ground)
    plant.Finalize()
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    # Drake ends the process where a corner lies in the plane exactly.
    lifted = pose[:3, 3] + np.array([0, 0, 1e-6])
    start = RigidTransform(RotationMatrix.ProjectToRotationMatrix(pose[:3, :3]), lifted)
    plant.SetFreeBodyPose(context, body, start)
    simulator.AdvanceTo(time_s)
    end = plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4()
    speed = float(np.abs(plant.GetVelocities(context)).max())
    corners = np.concatenate([_vertices(path) for path in sorted(folder.glob("collision_*.obj"))])
    lowest = float((corners @ end[2, :3]).min() + end[2, 3])
    return _rest(folder, pose, end, speed, max(0.0, -lowest))


def _vertices(path: Path) -> np.ndarray:
    """Return the vertices (n, 3) of an OBJ file."""
    lines = (line.split() for line in path.read_text(encoding="ascii").splitlines())
    return np.array([line[1:4] for line in lines if line and line[0] == "v"], dtype=np.float64)


def slide_in_mujoco(folder: Path, pose: np.ndarray, friction: float) -> float:
    """Return the friction that a body feels as it slides down a slope, over the stated one; 1 is right.

    On a slope a tenth steeper than the friction: from the acceleration over half a second. Gravity is
    turned, the body begins in its pose at rest.
    """
    import mujoco

    model = _on_a_plane(folder, pose).compile()
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    angle = np.arctan(1.1 * friction)
    model.opt.gravity[:] = GRAVITY * np.array([np.sin(angle), 0, -np.cos(angle)])
    data = mujoco.MjData(model)
    speeds = []
    for until_s in (0.5, 1.0):
        while data.time < until_s:
            mujoco.mj_step(model, data)
        speeds.append(data.qvel[0])
    acceleration = (speeds[1] - speeds[0]) / 0.5
    return float(np.tan(angle) - acceleration / (GRAVITY * np.cos(angle))) / friction


def drift_of_angular_momentum(folder: Path) -> float:
    """Return by what share the angular momentum of the spinning body changes in a second of free flight."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(_file(folder, "mjcf"))
    model.opt.gravity[:] = 0
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = 0.001
    data = mujoco.MjData(model)
    data.qvel[3:6] = [3.0, 5.0, 2.0]

    def momentum() -> np.ndarray:
        mujoco.mj_subtreeVel(model, data)
        return data.subtree_angmom[1].copy()

    mujoco.mj_forward(model, data)
    first = momentum()
    while data.time < 1.0:
        mujoco.mj_step(model, data)
    return float(np.linalg.norm(momentum() - first) / np.linalg.norm(first))


def _on_a_plane(folder: Path, pose: np.ndarray) -> Any:
    """Return an asset in a pose on a plane that leaves the friction to it."""
    import mujoco
    from scipy.spatial.transform import Rotation

    spec = mujoco.MjSpec.from_file(_file(folder, "mjcf"))
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    body = spec.worldbody.first_body()
    body.pos, body.quat = pose[:3, 3], [w, x, y, z]
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], friction=[1e-3, 1e-4, 1e-5])
    return spec


def _rest(folder: Path, start: np.ndarray, end: np.ndarray, speed: float, overlap: float) -> Rest:
    import json

    centre = np.array(json.loads((folder / "object.json").read_text())["centre_of_mass_m"])
    moved = (end - start)[:3, :3] @ centre + (end - start)[:3, 3]
    # Turning about the vertical is no tilt.
    tilt = np.degrees(np.arccos(np.clip(start[2, :3] @ end[2, :3], -1, 1)))
    return Rest(float(np.linalg.norm(moved)), float(tilt), speed, overlap, end)
