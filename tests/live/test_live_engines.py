"""MuJoCo and PyBullet tell the same of the same world: poses, masses, contacts; and what they refuse."""

import sys

import mujoco
import numpy as np
import pytest

import objectfolder
from objectfolder.errors import MissingPackageError, QueryError
from objectfolder.live import LiveSound, MujocoSimulation, PybulletSimulation

GRAVITY, STEP_S, RADIUS_M, MASS_KG = 9.81, 0.002, 0.06, 0.4
MOMENTS = (3e-4, 4e-4, 5e-4)
CENTRE_M = (0.01, 0.0, -0.02)
ARM_M = 0.3


def in_mujoco(height_m: float, sliding_m_s: float = 0.0) -> MujocoSimulation:
    """A ball whose mass lies beside its middle, above a plane."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP_S}" gravity="0 0 -{GRAVITY}"/><worldbody>'
        f'<geom type="plane" size="1 1 .1"/><body name="ball" pos="0 0 {height_m}"><freejoint/>'
        f'<inertial pos="{CENTRE_M[0]} {CENTRE_M[1]} {CENTRE_M[2]}" mass="{MASS_KG}"'
        f' diaginertia="{MOMENTS[0]} {MOMENTS[1]} {MOMENTS[2]}"/>'
        f'<geom type="sphere" size="{RADIUS_M}"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[0] = sliding_m_s
    return MujocoSimulation(model, data)


@pytest.fixture
def bullet():
    pybullet = pytest.importorskip("pybullet")
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setGravity(0, 0, -GRAVITY, physicsClientId=client)
    pybullet.setTimeStep(STEP_S, physicsClientId=client)
    yield pybullet, client
    pybullet.disconnect(client)


def in_bullet(bullet, height_m: float, sliding_m_s: float = 0.0, mass_kg: float = MASS_KG):
    pybullet, client = bullet
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
    sphere = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=RADIUS_M, physicsClientId=client)
    ground = pybullet.createMultiBody(0, plane, physicsClientId=client)
    ball = pybullet.createMultiBody(
        mass_kg,
        sphere,
        basePosition=[0, 0, height_m],
        baseInertialFramePosition=CENTRE_M,
        physicsClientId=client,
    )
    air = {"linearDamping": 0, "angularDamping": 0}  # there is none
    pybullet.changeDynamics(ball, -1, localInertiaDiagonal=MOMENTS, **air, physicsClientId=client)
    pybullet.resetBaseVelocity(ball, [sliding_m_s, 0, 0], physicsClientId=client)
    return PybulletSimulation(client, {"ball": ball, "world": ground})


def first_contact(simulation, body="ball"):
    """Step until the body touches, and return the contact with the body second."""
    for _ in range(400):
        simulation.step()
        for contact in simulation.touching():
            if contact.force_n > 0:
                return contact
    raise AssertionError("nothing touched")


def test_both_engines_tell_the_same_of_a_fall(bullet):
    height_m = RADIUS_M + 0.1
    figures = []
    for simulation in (in_mujoco(height_m, 0.4), in_bullet(bullet, height_m, 0.4)):
        contact = first_contact(simulation)
        sign = 1.0 if contact.bodies[1] == "ball" else -1.0
        assert set(contact.bodies) == {"world", "ball"}
        np.testing.assert_allclose(sign * contact.normal, [0, 0, 1], atol=1e-6)
        np.testing.assert_allclose(sign * contact.sliding_m_s, [0.4, 0, 0], atol=1e-3)
        assert contact.approach_m_s == pytest.approx(np.sqrt(2 * GRAVITY * 0.1), rel=0.02)
        pose = simulation.pose("ball")
        # Touched below the ball's own middle, not below its centre of mass.
        assert pose[2, 3] == pytest.approx(RADIUS_M, abs=5e-3)
        np.testing.assert_allclose(pose[:2, 3], contact.point_m[:2], atol=1e-4)
        figures.append((simulation.time_s, simulation.mass_kg("ball"), simulation.mass_at_kg(contact)))
    assert figures[0][0] == pytest.approx(figures[1][0], abs=3 * STEP_S)
    assert figures[0][1:] == pytest.approx(figures[1][1:], rel=1e-3)
    assert figures[0][2] < MASS_KG  # pushed beside its centre of mass, it turns


def test_what_stands_presses_with_its_weight_in_both_engines(bullet):
    for simulation in (in_mujoco(RADIUS_M), in_bullet(bullet, RADIUS_M)):
        for _ in range(500):
            simulation.step()
        (contact,) = simulation.touching()
        assert contact.force_n == pytest.approx(MASS_KG * GRAVITY, rel=0.15)  # it rocks about its centre
        assert contact.depth_m == pytest.approx(RADIUS_M - simulation.pose("ball")[2, 3], abs=1e-5)


def test_a_mug_that_falls_in_pybullet_is_heard(bullet):
    mug = objectfolder.example("mug")
    simulation = in_bullet(bullet, RADIUS_M + 0.1, mass_kg=mug.description["body"]["mass_kg"])
    live = LiveSound(simulation, {"ball": mug})
    sound = np.concatenate([live.block() for _ in range(25)])
    first = live.impacts[0]
    assert set(first.bodies) == {"world", "ball"}
    before = int(first.time_s * 44100)
    assert not sound[:before].any()
    assert np.abs(sound[before:]).max() > 0


def test_links_have_names_of_their_own(bullet):
    pybullet, client = bullet
    box = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[0.05] * 3, physicsClientId=client)
    arm = pybullet.createMultiBody(
        1.0,
        box,
        linkMasses=[0.25],
        linkCollisionShapeIndices=[box],
        linkVisualShapeIndices=[-1],
        linkPositions=[[ARM_M, 0, 0]],
        linkOrientations=[[0, 0, 0, 1]],
        linkInertialFramePositions=[[0, 0, 0]],
        linkInertialFrameOrientations=[[0, 0, 0, 1]],
        linkParentIndices=[0],
        linkJointTypes=[pybullet.JOINT_REVOLUTE],
        linkJointAxis=[[0, 0, 1]],
        physicsClientId=client,
    )
    simulation = PybulletSimulation(client, {"arm": arm})
    assert simulation.mass_kg("arm/0") == pytest.approx(0.25)
    np.testing.assert_allclose(simulation.pose("arm/0")[:3, 3], [ARM_M, 0, 0], atol=1e-6)


def test_an_unknown_body_and_a_missing_engine_are_one_line(bullet, monkeypatch):
    simulation = in_bullet(bullet, 1.0)
    with pytest.raises(QueryError, match="no body 'cup' in the simulation"):
        simulation.mass_kg("cup")
    with pytest.raises(QueryError, match="'cup' is no body of the world"):
        PybulletSimulation(bullet[1], {"cup": 99})
    for engine, make in (
        ("pybullet", lambda: PybulletSimulation(0, {})),
        ("mujoco", lambda: MujocoSimulation(None, None)),
    ):
        monkeypatch.setitem(sys.modules, engine, None)
        with pytest.raises(MissingPackageError, match=rf"{engine}: is not installed. .*factory\[{engine}\]"):
            make()
