"""Grasps of an object on a table, by two tactile fingers: what they see and feel, and whether they hold.

The object is turned and moved instead of the gripper, which is the same. Images of the gels are taken when
the fingers have closed and before they lift: how deep the object lies in them, and how their markers have
moved, are the force's doing.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from objectfolder.errors import InputError, QueryError
from objectfolder.live import Felt, Finger, LiveTouch, MujocoSimulation
from objectfolder.live.gripper import FINGERS, HIGHEST_M, gripper, recess_m
from objectfolder.object_file import ObjectFile
from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import look_at

Floats = NDArray[np.float64]
Act = Iterator[None]  # sets what the fingers' motors do, and yields before each step of the simulation
PARTS = 64  # that the gels' contacts follow the surface to a millimetre
FRICTION, GRAVITY_M_S2 = 0.8, 9.81
FALLING_S, MOST_CLOSING_S, SETTLING_S, STEP_S = 2.0, 3.0, 0.2, 0.02
AWAY_M = 0.3  # of the fingers, as the object falls
LIFT_M, LIFTING_M_S = 0.18, 0.3
HELD_SHARE = 0.8  # of the lift, that a held object has risen
# Of the least force that holds the weight of a block between the fingers.
FORCE_SHARES, WEAKEST_N = (0.5, 5.0), 0.4
SURFACE_POINTS, NEAREST_POINTS, MOST_TRIES = 4000, 100, 4
YAW_RAD, OFFSET_M, HEIGHT_SHARE = 0.5, 0.02, 0.3
# Of the camera from the object, in lengths of half its longest side, or of this where that is shorter: up to
# twice of it all objects are seen from as far, so that an image shows their size.
VIEW, SHORTEST_HALF_M = np.array([1.6, -1.6, 1.2]), 0.1


@dataclass(frozen=True)
class Grasp:
    """Where and how hard the fingers close.

    Attributes
    ----------
    yaw_rad
        Of the object, from where it is narrowest between the fingers.
    offset_m
        Of the fingers from the centre of mass, across their way.
    height_share
        Of the fingers over the middle of the object's height between them, in halves of it.
    force_n
        Of each finger.
    """

    yaw_rad: float
    offset_m: float
    height_share: float
    force_n: float


@dataclass(frozen=True)
class Outcome:
    """What a grasp showed, and what came of it.

    Attributes
    ----------
    image
        (pixels, pixels, 3) uint8 of the object from where the camera stands, before the fingers close.
    touch
        (2, 160, 120, 3) uint8 of both gels with their markers, after they have closed.
    risen_share
        How far the object's centre of mass has risen, over how far the fingers have.
    """

    image: NDArray[np.uint8]
    touch: NDArray[np.uint8]
    risen_share: float

    @property
    def held(self) -> bool:
        """Whether the object came along."""
        return self.risen_share >= HELD_SHARE


def least_force_n(file: ObjectFile) -> float:
    """Return the force of each finger whose friction bears the weight, `WEAKEST_N` at least."""
    return max(WEAKEST_N, float(file.description["body"]["mass_kg"]) * GRAVITY_M_S2 / (2 * FRICTION))


def drawn_grasps(file: ObjectFile, seed: int) -> Iterator[Grasp]:
    """Yield grasps without end, askew and off the middle, with forces about what the weight asks for."""
    random = np.random.default_rng(seed)
    least, (low, high) = least_force_n(file), np.log(FORCE_SHARES)
    while True:
        yield Grasp(
            yaw_rad=random.uniform(-YAW_RAD, YAW_RAD) + random.choice([0.0, np.pi]),
            offset_m=random.uniform(-OFFSET_M, OFFSET_M),
            height_share=random.uniform(-HEIGHT_SHARE, HEIGHT_SHARE),
            force_n=least * np.exp(random.uniform(low, high)),
        )


class World:
    """An object on a table between two fingers.

    Parameters
    ----------
    file
        The object.
    hulls
        Its convex parts, object frame.

    Attributes
    ----------
    file
        The object.
    simulation
        With bodies ``object`` and `FINGERS`.
    """

    def __init__(self, file: ObjectFile, hulls: Sequence[Surface]) -> None:
        self.file = file
        self._model = gripper(file, FRICTION, hulls=hulls)
        self._data = mujoco.MjData(self._model)
        self.simulation = MujocoSimulation(self._model, self._data)
        fingers = {name: Finger(friction=FRICTION) for name in FINGERS}
        self._touch = LiveTouch(self.simulation, {"object": file}, fingers)
        self._apex_m = self.simulation.pose(FINGERS[0])[:3, 3] + [0, 0, file.touch.sensor.gel_apex_m[2]]
        self._model.actuator_actrange[:, 0] = -HIGHEST_M  # also below where they start
        body = self._data.body("object").id
        self._first = int(self._model.jnt_qposadr[self._model.body_jntadr[body]])
        self._rest = self._settled()
        points, _ = file.sample_contacts(SURFACE_POINTS, seed=0, reachable=False)
        self._points = points @ self._rest[:3, :3].T + self._rest[:3, 3]
        self._inertial = np.array([*file.description["body"]["centre_of_mass_m"], 1.0])
        self._centre = self._rest @ self._inertial
        angles = np.linspace(0.0, np.pi, 180, endpoint=False)
        across = self._points[:, :2] @ [np.sin(angles), np.cos(angles)]
        self._narrow_rad = float(angles[np.ptp(across, axis=0).argmin()])
        away = VIEW * max(SHORTEST_HALF_M, file.frame.scale)
        self._camera = look_at(self._centre[:3] + away, self._centre[:3])[0]

    def _settled(self) -> Floats:
        """Let the object stand or fall on the table, and return its pose."""
        for name in FINGERS:
            self._data.joint(f"{name}_close").qpos[0] = -AWAY_M
        self._do(self.holding(FALLING_S, 0.0))
        return self.simulation.pose("object")

    def attempt(self, grasp: Grasp, pixels: int) -> Outcome:
        """Close the fingers, look at what they feel, and lift by `LIFT_M`.

        Raises
        ------
        QueryError
            The gels cannot show it: pressed in deeper than they give way, or by a collision part that stands
            off the surface.
        """
        self.place(grasp)
        image = self._image(pixels)
        self._do(self.closing(grasp.force_n))
        felt = self.feel()
        touch = np.stack([felt[name].markers().drawn_on(felt[name].image.rgb) for name in FINGERS])
        return Outcome(image, touch, self.lift(grasp.force_n))

    def close(self, grasp: Grasp) -> None:
        """Stand the object where the grasp says, and close the fingers."""
        self.place(grasp)
        self._do(self.closing(grasp.force_n))

    def feel(self) -> dict[str, Felt]:
        """Return what each of `FINGERS` feels.

        Raises
        ------
        QueryError
            The object lies deeper in a gel than that gives way.
        """
        return self._touch.feel()

    @property
    def opening_m(self) -> float:
        """Distance of the gels' apices."""
        left, right = (self.simulation.pose(name) for name in FINGERS)
        return float(abs(left[1, 3] - right[1, 3]) - 2 * self.file.touch.sensor.gel_apex_m[0])

    def lift(self, force_n: float) -> float:
        """Lift the closed fingers by `LIFT_M`, and return `risen_share`."""
        self._do(self.lifting(force_n))
        return self.risen_share

    @property
    def risen_share(self) -> float:
        """How far the centre of mass has risen from where it rests, over `LIFT_M`."""
        return float((self.simulation.pose("object") @ self._inertial)[2] - self._centre[2]) / LIFT_M

    def place(self, grasp: Grasp) -> None:
        """Stand the object before the fingers, which are open as far as it is wide between them."""
        model, data = self._model, self._data
        mujoco.mj_resetData(model, data)
        turn = Rotation.from_rotvec([0, 0, self._narrow_rad + grasp.yaw_rad]).as_matrix()
        place = np.array([self._apex_m[0] + grasp.offset_m, 0, 0]) - turn @ self._centre[:3] * [1, 1, 0]
        data.qpos[self._first : self._first + 3] = turn @ self._rest[:3, 3] + place
        quaternion = Rotation.from_matrix(turn @ self._rest[:3, :3]).as_quat(scalar_first=True)
        data.qpos[self._first + 3 : self._first + 7] = quaternion
        x, y, z = turn @ self._points.T + place[:, None]
        near = z[np.argsort(np.abs(x - self._apex_m[0]))[:NEAREST_POINTS]]
        height = (near.max() + near.min()) / 2 + np.ptp(near) / 2 * grasp.height_share
        recedes = recess_m(self.file.touch.sensor, x - self._apex_m[0], z - height)
        if not np.isfinite(recedes).any():  # they will close on nothing, from beside the object
            recedes = np.zeros(len(y))
        low, high = self.file.surface.bounds[:, 1]
        data.joint("left_close").qpos[0] = (y + recedes).min() - low
        data.joint("right_close").qpos[0] = high - (y - recedes).max()
        for number, name in enumerate(FINGERS):
            data.joint(f"{name}_lift").qpos[0] = data.act[number] = height - self._apex_m[2]
        mujoco.mj_forward(model, data)

    def closing(self, force_n: float) -> Act:
        """Close the fingers until both have touched, and let them settle."""
        for _ in range(round(MOST_CLOSING_S / STEP_S)):
            yield from self.holding(STEP_S, force_n)
            touched = {name for contact in self.simulation.touching() for name in contact.bodies}
            if touched.issuperset(FINGERS):
                break
        yield from self.holding(SETTLING_S, force_n)

    def lifting(self, force_n: float) -> Act:
        """Lift the fingers by `LIFT_M`, and let them settle."""
        yield from self.holding(LIFT_M / LIFTING_M_S, force_n, LIFTING_M_S)
        yield from self.holding(SETTLING_S, force_n)

    def holding(self, time_s: float, force_n: float, lifting_m_s: float = 0.0) -> Act:
        """Press with a force, and lift at a speed, for a time."""
        self._data.ctrl[:] = [force_n, force_n, lifting_m_s, lifting_m_s]
        for _ in range(round(time_s / self.simulation.timestep_s)):
            yield

    def _do(self, act: Act) -> None:
        for _ in act:
            self.simulation.step()

    def _image(self, pixels: int) -> NDArray[np.uint8]:
        camera = np.linalg.inv(self.simulation.pose("object")) @ self._camera
        lamp = self._inertial[:3] + self.file.frame.scale * (1.2 * camera[:3, 2] + camera[:3, 1] / 2)
        return np.asarray(self.file.render(camera, lamp, pixels, sub_rays=4)[0])


def attempts(world: World, count: int, seed: int, pixels: int) -> dict[str, NDArray[Any]]:
    """Try grasps until `count` were seen and felt.

    Returns
    -------
    image, touch
        (n, ...) uint8, see `Outcome`.
    grasp
        (n, 4) float64, the fields of `Grasp`.
    held
        (n,) bool.
    unseen
        () how many grasps were left out, as the gels could not show them.

    Raises
    ------
    InputError
        Most grasps cannot be shown.
    """
    trials: list[tuple[Outcome, Grasp]] = []
    for tried, grasp in enumerate(drawn_grasps(world.file, seed)):
        with suppress(QueryError):
            trials.append((world.attempt(grasp, pixels), grasp))
        if len(trials) == count:
            break
        if tried > MOST_TRIES * count:
            name = world.file.description["object"]["name"]
            remedy = "Leave it out: its collision parts stand off its surface"
            raise InputError(name, f"the gels show {len(trials)} of {tried} grasps", remedy)
    outcomes, grasps = zip(*trials, strict=True)
    return {
        "image": np.stack([outcome.image for outcome in outcomes]),
        "touch": np.stack([outcome.touch for outcome in outcomes]),
        "grasp": np.array([astuple(grasp) for grasp in grasps]),
        "held": np.array([outcome.held for outcome in outcomes]),
        "unseen": np.array(tried + 1 - count),
    }
