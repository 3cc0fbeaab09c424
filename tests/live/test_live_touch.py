"""Fingers in a simulation: the images of `press`, the engine's forces, slip, and the markers that follow."""

from dataclasses import dataclass, field

import mujoco
import numpy as np
import pytest

import objectfolder
from objectfolder.errors import QueryError
from objectfolder.live import Finger, LiveTouch, MujocoSimulation, PybulletSimulation, Touching
from objectfolder.live.gripper import FINGERS, gripper
from objectfolder.live.touch import _force_n
from objectfolder.touch import read_sensor

MUG = objectfolder.example("mug")
GRAVITY, MASS_KG = 9.81, 0.2


@dataclass
class Posed:
    """A simulation that stands still: poses and contacts as they are told."""

    poses: dict[str, np.ndarray]
    contacts: list[Touching] = field(default_factory=list)
    time_s = 0.0
    timestep_s = 0.002

    def step(self):
        pass

    def pose(self, body):
        if body not in self.poses:
            raise QueryError("files", f"no body {body!r} in the simulation", "Name its bodies.")
        return self.poses[body]

    def mass_kg(self, body):
        return 1.0

    def mass_at_kg(self, touching):
        return 1.0

    def touching(self):
        return self.contacts


def pressed(**settings):
    """A touch of the mug's wall, half way up."""
    touches = MUG.press([[0.0, -0.041, 0.05]], **settings)
    assert touches.reachable.all()
    return touches


def turned(axis, degrees, place=(0, 0, 0)):
    pose, axis = np.eye(4), np.asarray(axis, float)
    mujoco.mju_axisAngle2Quat(quaternion := np.zeros(4), axis, np.radians(degrees))
    mujoco.mju_quat2Mat(rotation := np.zeros(9), quaternion)
    pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), place
    return pose


def felt(finger_pose, mug_pose=None, contacts=(), finger=None, **settings):
    poses = {"mug": np.eye(4) if mug_pose is None else mug_pose, "finger": finger_pose}
    simulation = Posed(poses, list(contacts))
    return LiveTouch(simulation, {"mug": MUG}, {"finger": finger or Finger()}, **settings).feel()["finger"]


def bearing(pose, force_sensor_n, place_m=(0.0, 0.0, 0.0), depth_m=0.0):
    """A contact that pushes the finger at a pose by a force (3,) in its own frame; the mug is first."""
    force = pose[:3, :3] @ np.asarray(force_sensor_n, float)
    along = -pose[:3, 0]
    normal_n = float(force @ along)
    return Touching(
        ("mug", "finger"), pose[:3, 3] + pose[:3, :3] @ place_m, along, normal_n, np.zeros((2, 3)),
        force - normal_n * along, depth_m,
    )  # fmt: skip


@pytest.mark.parametrize(
    "asked", [{}, {"depth_m": 0.0004}, {"tilt_deg": 9.0, "azimuth_deg": 50.0}, {"roll_deg": 77.0}]
)
def test_a_finger_sees_what_a_press_at_that_pose_sees(asked):
    touches = pressed(**asked)
    touch = felt(touches.sensor_to_object[0])
    assert touch.touched == "mug"
    np.testing.assert_array_equal(touch.image.rgb, touches.rgb[0])
    np.testing.assert_array_equal(touch.image.depth, touches.depth_m[0])
    np.testing.assert_array_equal(touch.image.mask, touches.mask[0])
    assert touch.penetration_m == pytest.approx(touches.penetration_m[0], abs=1e-12)


def test_a_finger_presses_with_the_sensor_that_the_files_were_made_with():
    gelsight_mug = objectfolder.example("mug")
    gelsight_mug.touch.net.sensor = read_sensor("gelsight").at_resolution(48, 64)
    touches = gelsight_mug.press([[0.0, -0.041, 0.05]])
    simulation = Posed({"mug": np.eye(4), "finger": touches.sensor_to_object[0]})
    touch = LiveTouch(simulation, {"mug": gelsight_mug}, {"finger": Finger()}).feel()["finger"]
    np.testing.assert_array_equal(touch.image.rgb, touches.rgb[0])
    simulation.poses |= {"mine": np.eye(4), "twin": np.eye(4)}
    files = {"mine": MUG, "twin": MUG, "mug": gelsight_mug}
    with pytest.raises(QueryError, match="'mine' was made with another sensor than 'mug'"):
        LiveTouch(simulation, files, {"finger": Finger()})
    chosen = {"finger": Finger(sensor=gelsight_mug.touch.sensor)}
    assert LiveTouch(simulation, files, chosen).sensors == {"finger": gelsight_mug.touch.sensor}


def test_where_the_world_stands_changes_nothing_but_rounding():
    touches = pressed()
    world = turned([0.6, 0.0, 0.8], 123.0, (0.3, -2.0, 0.7))
    touch = felt(world @ touches.sensor_to_object[0], world)
    assert touch.penetration_m == pytest.approx(1e-3, abs=1e-12)
    np.testing.assert_allclose(touch.image.depth, touches.depth_m[0], atol=2**-23)
    assert np.abs(touch.image.rgb.astype(int) - touches.rgb[0]).max() <= 1
    np.testing.assert_allclose(touch.sensor_to_object, touches.sensor_to_object[0], atol=1e-12)


def test_a_finger_rolled_about_its_axis_is_a_press_at_that_roll():
    axis = MUG.touch.sensor.gel_apex_m
    about = turned([1, 0, 0], 30.0)
    about[:3, 3] = np.array(axis) - about[:3, :3] @ axis
    touch = felt(pressed().sensor_to_object[0] @ about)
    for roll in (30.0, -30.0):
        difference = np.abs(touch.image.rgb.astype(int) - pressed(roll_deg=roll).rgb[0]).max()
        assert (difference <= 1) == (roll < 0)


def test_a_sensor_may_stand_anywhere_in_its_body():
    touches = pressed()
    mount = turned([0, 1, 0], 40.0, (0.01, 0.02, 0.03))
    body = touches.sensor_to_object[0] @ np.linalg.inv(mount)
    touch = felt(body, finger=Finger(sensor_to_body=mount))
    np.testing.assert_allclose(touch.sensor_to_object, touches.sensor_to_object[0], atol=1e-12)


def test_the_object_that_lies_deepest_is_seen():
    pose = pressed().sensor_to_object[0]
    deeper = np.eye(4)
    deeper[:3, 3] -= 0.0005 * pose[:3, 0]
    simulation = Posed({"far": np.eye(4), "near": deeper, "finger": pose})
    touch = LiveTouch(simulation, {"far": MUG, "near": MUG}, {"finger": Finger()}).feel()["finger"]
    assert (touch.touched, round(touch.penetration_m, 9)) == ("near", 0.0015)


@pytest.mark.parametrize("off_m", [0.0002, 0.003])
def test_a_finger_that_shapes_stop_before_the_surface_feels_it_as_deep(off_m):
    touches = pressed(depth_m=4e-4)
    pose = touches.sensor_to_object[0].copy()
    pose[:3, 3] -= (4e-4 + off_m) * pose[:3, 0]
    contacts = [bearing(pose, [-2.0, 0.0, 0.0], MUG.touch.sensor.gel_apex_m, 5e-4)]
    touch = felt(pose, contacts=contacts, onto_surface=True)
    assert touch.touched == "mug"
    assert touch.advanced_m == pytest.approx(4e-4 + off_m, abs=1e-9)
    np.testing.assert_allclose(touch.sensor_to_object, touches.sensor_to_object[0], atol=1e-9)
    np.testing.assert_allclose(touch.image.depth, touches.depth_m[0], atol=2**-23)
    assert touch.pressed.force_n == pytest.approx(2.0), "and it bears the force there"
    assert felt(pose, contacts=contacts).touched is None


@pytest.mark.parametrize(
    ("off_m", "place_m", "depth_m"),
    [
        (0.0102, (0.022, 0.0, 0.015), 5e-4),  # too far from the surface
        (0.003, (0.022, 0.0125, 0.015), 5e-4),  # beside the gel
        (0.003, (0.022, 0.0, -0.0025), 5e-4),  # below it
        (-4.1e-4, (0.022, 0.0, 0.015), 5e-4),  # the shapes follow the surface
        (0.003, (0.022, 0.0, 0.015), 0.0),  # an engine that tells no depth
    ],
)
def test_other_fingers_are_felt_where_they_are(off_m, place_m, depth_m):
    pose = pressed(depth_m=1e-3).sensor_to_object[0].copy()
    pose[:3, 3] -= (1e-3 + off_m) * pose[:3, 0]
    contacts = [bearing(pose, [-2.0, 0.0, 0.0], place_m, depth_m)]
    touch = felt(pose, contacts=contacts, onto_surface=True)
    assert (touch.advanced_m, touch.touched) == (0.0, "mug" if off_m < 0 else None)
    np.testing.assert_allclose(touch.sensor_to_object, pose, atol=1e-15)


def test_fingers_feel_a_bell_whose_hull_they_press():
    """Its waist lies 1 mm and more inside its hull."""
    bell = objectfolder.example("bell")
    model = gripper(bell)
    data = mujoco.MjData(model)
    simulation = MujocoSimulation(model, data)
    fingers = {name: Finger(friction=0.8) for name in FINGERS}
    touch = LiveTouch(simulation, {"object": bell}, fingers, onto_surface=True)
    data.ctrl[:2] = 4.0
    for _ in range(300):
        simulation.step()
    depths = [contact.depth_m for contact in simulation.touching() if "left" in contact.bodies]
    feeling = touch.feel()["left"]
    assert feeling.normal_n == pytest.approx(4.0, rel=0.05)
    assert feeling.advanced_m > 1e-3
    assert feeling.penetration_m == pytest.approx(max(depths) - 1e-4, abs=1e-9)
    poses = {"bell": np.eye(4), "finger": feeling.sensor_to_object}
    expected = LiveTouch(Posed(poses), {"bell": bell}, {"finger": Finger()}).feel()["finger"]
    np.testing.assert_array_equal(feeling.image.rgb, expected.image.rgb)


def test_an_object_that_presses_from_a_hair_beyond_the_gel_drags_its_markers():
    """Engines let a contact end a little apart, with its last force."""
    pose = pressed().sensor_to_object[0].copy()
    pose[:3, 3] -= 0.00105 * pose[:3, 0]
    away = np.eye(4)
    away[:3, 3] = 0, 1, 0
    simulation = Posed({"other": away, "mug": np.eye(4), "finger": pose}, [bearing(pose, [-2.0, 0.5, 0.0])])
    touch = LiveTouch(simulation, {"other": MUG, "mug": MUG}, {"finger": Finger()}).feel()["finger"]
    assert touch.touched is None
    assert touch.sheared[0].force_n == pytest.approx(2.0)
    assert touch.markers().displacement_m[:, 1].max() > 1e-5


def test_an_untouched_finger_sees_its_gel_and_its_markers_rest():
    pose = pressed().sensor_to_object[0].copy()
    pose[:3, 3] -= 0.05 * pose[:3, 0]
    touch = felt(pose)
    assert touch.touched is None
    np.testing.assert_array_equal(touch.image.rgb, MUG.touch.no_contact)
    assert (touch.penetration_m, touch.normal_n, touch.tangential_n, touch.sliding) == (0, 0, 0, False)
    markers = touch.markers()
    np.testing.assert_allclose(markers.pixels, markers.rest_pixels, atol=1e-9)


def test_forces_of_all_contacts_with_objects_add_up_in_the_sensors_frame():
    pose = pressed().sensor_to_object[0]
    strong, weak = bearing(pose, [-3.0, 0.5, 0.0]), bearing(pose, [-1.0, 0.0, -0.25])
    turned_round = Touching(
        weak.bodies[::-1], weak.point_m, -weak.normal, weak.force_n, weak.velocities_m_s, -weak.friction_n
    )
    table = Touching(("table", "finger"), strong.point_m, strong.normal, 99.0, strong.velocities_m_s)
    touch = felt(pose, contacts=[strong, turned_round, table])
    np.testing.assert_allclose(touch.force_n, [-4.0, 0.5, -0.25], atol=1e-12)
    assert touch.normal_n == pytest.approx(4.0)
    assert touch.tangential_n == pytest.approx(np.hypot(0.5, 0.25))


@pytest.mark.parametrize(("across", "sliding"), [(0.0, False), (1.9, False), (1.99, True), (2.2, True)])
def test_it_slides_where_the_force_across_is_all_that_friction_bears(across, sliding):
    pose = pressed().sensor_to_object[0]
    touch = felt(pose, contacts=[bearing(pose, [-4.0, across, 0.0])], finger=Finger(friction=0.5))
    assert touch.sliding == sliding
    contact, shear = touch.sheared
    assert contact.force_n == pytest.approx(4.0)
    area = contact.pitch_m[0] * contact.pitch_m[1]
    np.testing.assert_allclose(shear.traction_pa.sum(axis=(1, 2)) * area, [0, -min(across, 2.0)], atol=1e-6)
    assert shear.sticking.any() == (across < 2.0)


def test_markers_are_dragged_the_way_the_object_pulls():
    pose = pressed().sensor_to_object[0]
    still = felt(pose, contacts=[bearing(pose, [-4.0, 0.0, 0.0])]).markers()
    dragged = felt(pose, contacts=[bearing(pose, [-4.0, 0.0, 1.5])]).markers()
    change = dragged.displacement_m - still.displacement_m
    largest = int(np.argmax(np.abs(change).max(axis=1)))
    assert change[largest, 2] > 2e-5  # towards the sensor's z, the image's top
    assert (dragged.pixels - still.pixels)[largest, 0] < -0.1
    assert np.abs(change[largest, :2]).max() < 0.2 * change[largest, 2]
    image = felt(pose).image.rgb
    assert (dragged.drawn_on(image) != still.drawn_on(image)).any()


def test_two_contacts_twist_the_gel_and_what_slipped_stays():
    pose = pressed().sensor_to_object[0]

    def contacts(across_n):
        places = (0.0, 0.002, 0.015), (0.0, -0.002, 0.015)
        return [
            bearing(pose, [-2.0, 0.0, side * across_n], place)
            for side, place in zip((1, -1), places, strict=True)
        ]

    twisted = felt(pose, contacts=contacts(0.3))
    assert twisted.torque_nm == pytest.approx(0.3 * 0.004)
    assert felt(pose, contacts=contacts(0.3)[:1]).torque_nm is None
    shear = twisted.sheared[1]
    # A torque on the gel about +x turns it from y to z: rows descend in z and columns in y.
    assert shear.twist_rad < 0
    rest = felt(pose, contacts=contacts(0.0))
    assert abs(rest.sheared[1].twist_rad) < 1e-3 * abs(shear.twist_rad)
    released = rest.sheared_after(shear)[1]
    assert 0.01 < released.twist_rad / shear.twist_rad < 0.9
    drag_m = rest.markers(before=shear).displacement_m - rest.markers().displacement_m
    assert np.abs(drag_m).max() > 1e-7


def squeezed(engine, tilt_deg, friction=0.6):
    """A plate with the mug's file that lies on a finger's gel, both leaning, after half a second."""
    top = MUG.touch.sensor.gel_apex_m[0]
    lean = turned([1, 0, 0], tilt_deg)
    upward = lean @ turned([0, 1, 0], -90.0)  # the sensor's x is up
    plate = lean @ turned([1, 0, 0], 0.0, (-0.015, 0, top + 0.005))
    if engine == "mujoco":
        place, quaternion = plate[:3, 3], np.zeros(4)
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, plate[:3, :3].ravel())
        mujoco.mju_mat2Quat(turn, upward[:3, :3].ravel())
        texts = " ".join(map(str, place)), " ".join(map(str, quaternion)), " ".join(map(str, turn))
        # It may move but not turn: it would rock on its corners.
        joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
        model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep=".002" gravity="0 0 -{GRAVITY}" cone="elliptic"/>'
            f'<worldbody><body name="finger" quat="{texts[2]}">'
            f'<geom type="box" pos="{top / 2} 0 .015" size="{top / 2} .05 .05" friction="{friction}"/></body>'
            f'<body name="mug" pos="{texts[0]}" quat="{texts[1]}">{joints}'
            f'<geom type="box" size=".02 .02 .005" mass="{MASS_KG}" friction="{friction}"/></body>'
            f"</worldbody></mujoco>"
        )
        simulation = MujocoSimulation(model, mujoco.MjData(model))
        for _ in range(60):
            simulation.step()
        return simulation
    pybullet, client = engine
    frames = []
    for pose in (upward @ turned([1, 0, 0], 0, (top / 2, 0, 0.015)), plate):
        mujoco.mju_mat2Quat(quaternion := np.zeros(4), pose[:3, :3].ravel())
        frames.append((pose[:3, 3].tolist(), quaternion[[1, 2, 3, 0]].tolist()))
    sizes, masses, bodies = ([top / 2, 0.05, 0.05], [0.02, 0.02, 0.005]), (0, MASS_KG), []
    for (place, quaternion), size, mass in zip(frames, sizes, masses, strict=True):
        box = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=size, physicsClientId=client)
        body = pybullet.createMultiBody(mass, box, -1, place, quaternion, physicsClientId=client)
        pybullet.changeDynamics(body, -1, lateralFriction=friction**0.5, physicsClientId=client)
        bodies.append(body)
    simulation = PybulletSimulation(client, {"finger": bodies[0], "mug": bodies[1]})
    for _ in range(60):
        simulation.step()
    return simulation


@pytest.fixture
def bullet():
    pybullet = pytest.importorskip("pybullet")
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setGravity(0, 0, -GRAVITY, physicsClientId=client)
    pybullet.setTimeStep(0.002, physicsClientId=client)
    yield pybullet, client
    pybullet.disconnect(client)


@pytest.mark.parametrize("tilt_deg", [15.0, 45.0])
@pytest.mark.parametrize("engine", ["mujoco", "bullet"])
def test_both_engines_tell_what_a_leaning_finger_bears(bullet, engine, tilt_deg):
    """What sticks bears the weight; what slides bears friction times its normal part, and gains speed.

    MuJoCo lets what slides hop from step to step: over all of them forces are what momentum says.
    """
    simulation = squeezed(bullet if engine == "bullet" else engine, tilt_deg)
    places, forces = [], []
    for _ in range(40):
        simulation.step()
        places.append(simulation.pose("mug")[:3, 3].copy())
        forces.append(_force_n("finger", simulation.touching()))
    velocities = np.diff(places, axis=0) / 0.002
    gained = (velocities[-1] - velocities[0]) / (len(velocities) - 1) / 0.002
    force = np.mean(forces[1:-1], axis=0)
    np.testing.assert_allclose(force, MASS_KG * (np.array([0, 0, -GRAVITY]) - gained), atol=0.005)
    slope = np.radians(tilt_deg)
    normal_n = force @ [0, np.sin(slope), -np.cos(slope)]
    across_n = force @ [0, -np.cos(slope), -np.sin(slope)]
    if tilt_deg < np.degrees(np.arctan(0.6)):
        np.testing.assert_allclose(force, [0, 0, -MASS_KG * GRAVITY], atol=0.05)
    else:
        assert across_n == pytest.approx(0.6 * normal_n, rel=0.02)


def test_what_makes_no_sense_is_one_line():
    pose = pressed().sensor_to_object[0]
    files, fingers = {"mug": MUG}, {"finger": Finger()}
    with pytest.raises(QueryError, match="no body 'thumb' in the simulation"):
        LiveTouch(Posed({"mug": np.eye(4), "finger": pose}), files, {"thumb": Finger()})
    with pytest.raises(QueryError, match="files: none given"):
        LiveTouch(Posed({"finger": pose}), {}, fingers)
    for broken in ("mug", "finger"):
        poses = {"mug": np.eye(4), "finger": pose}
        touch = LiveTouch(Posed(poses), files, fingers)
        poses[broken] = np.full((4, 4), np.nan)
        with pytest.raises(QueryError, match=f"the pose of '{broken}' is not finite"):
            touch.feel()
    for friction in (-0.1, np.nan, "rubber"):
        with pytest.raises(QueryError, match="friction"):
            Finger(friction=friction)
    for mount in (np.eye(3), 2 * np.eye(4), np.diag([-1.0, 1, 1, 1]), np.full((4, 4), np.nan)):
        with pytest.raises(QueryError, match="sensor_to_body"):
            Finger(sensor_to_body=mount)
    with pytest.raises(QueryError, match="samples"):
        Finger(samples=0)


def test_a_finger_does_not_feel_beyond_its_gel():
    pose = pressed().sensor_to_object[0]
    deep = pose.copy()
    deep[:3, 3] += 0.0045 * pose[:3, 0]
    with pytest.raises(
        QueryError, match=r"finger: 'mug' lies 5\.5 mm in its gel, deeper than that gives way"
    ):
        felt(deep)
    with pytest.raises(QueryError, match=r"finger: bears 9e\+03 N, more than its gel"):
        felt(pose, contacts=[bearing(pose, [-9000.0, 0, 0])]).markers()
    away = pose.copy()
    away[:3, 3] -= 0.05 * pose[:3, 0]
    with pytest.raises(QueryError, match=r"finger: bears 2 N of an object that is not at its gel"):
        felt(away, contacts=[bearing(away, [-2.0, 0, 0])]).markers()


def test_an_image_that_is_asked_for_late_is_that_of_when_it_was_felt():
    touches = pressed(depth_m=0.0008)
    simulation = Posed({"mug": np.eye(4), "finger": touches.sensor_to_object[0]})
    touch = LiveTouch(simulation, {"mug": MUG}, {"finger": Finger()})
    before = touch.feel()["finger"]
    simulation.poses["finger"] = simulation.poses["finger"] @ turned((1, 0, 0), 0, (-0.0004, 0.002, 0.001))
    assert (touch.feel()["finger"].image.rgb != touches.rgb[0]).any()
    np.testing.assert_array_equal(before.image.rgb, touches.rgb[0])
