"""What tactile sensors feel of a simulation's objects: images, forces, slip and shear."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import QueryError
from objectfolder.forks import hold_forks
from objectfolder.live.contacts import Simulation, Touching, finite_pose
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.object_file.shared_sensor import shared_sensor
from objectfolder.query_values import real, real_array, whole
from objectfolder.touch.contact.height_field import gap_field
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.elastic.contact_problem import Contact, solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.markers import Markers, moved_markers
from objectfolder.touch.elastic.shear import Shear, solve_shear
from objectfolder.touch.presses.elastic_press import greatest_depth_m
from objectfolder.touch.presses.touches import TOLERANCE_M, saturation_depth_m
from objectfolder.touch.rendering.simulator import Near, Simulator, TouchImage
from objectfolder.touch.sensor.sensor import Sensor

Floats = NDArray[np.float64]
# Of the largest friction: engines bring a body that slides to a little less.
SLIDING_SHARE = 0.99
CELL_M, CONTACT_TOLERANCE = 0.0005, 1e-3  # of the gel's contact
APART_M = 0.001  # that collision shapes may stand off the surface
# Shapes that follow the surface to the first are believed. A finger that they stop before it is taken on by
# the second at most, where a contact lies over its gel or no farther than the third beside it.
FOLLOWED_M, FARTHEST_M, BESIDE_M = 1e-4, 0.01, 0.002


@dataclass(frozen=True, eq=False)
class Finger:
    """A tactile sensor on a body of the simulation.

    Parameters
    ----------
    sensor_to_body
        (4, 4) pose of the sensor's frame in the body's, metres; by default they are one.
    sensor
        What presses; the one that the Object Files were made with if None.
    friction
        Coulomb's coefficient of gel and object: that of the scene.
    samples
        Samples along each side of a pixel.

    Raises
    ------
    QueryError
        A pose that is none, a friction below 0, samples out of range.
    """

    sensor_to_body: Floats = field(default_factory=lambda: np.eye(4))
    sensor: Sensor | None = None
    friction: float = 1.0
    samples: int = 2

    def __post_init__(self) -> None:
        pose = real_array("sensor_to_body", self.sensor_to_body)
        turn = pose[:3, :3] if pose.shape == (4, 4) else np.zeros((3, 3))
        if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) or np.linalg.det(turn) < 0:
            raise QueryError("sensor_to_body", "not a pose", "Give (4, 4): a rotation and a place.")
        real("friction", self.friction, 0.0, 1e3)
        whole("samples", self.samples, 1, 16)


@dataclass(frozen=True, eq=False)
class Felt:
    """What a finger feels.

    Parameters
    ----------
    finger, name, sensor
        Which one, and what presses.
    touched
        The body that lies deepest in the gel; None where none does.
    sensor_to_object
        (4, 4) pose in the frame of the body touched, else of that which presses most, else of any.
    penetration_m
        How deep that body lies in the gel.
    force_n
        (3,) float64 of the engine's contacts with objects, on the finger, in the sensor's frame.
    advanced_m
        How far beyond the finger's own pose the sensor is here, along its axis; see `LiveTouch`.
    torque_nm
        Of the same contacts on the finger, about its sensor's axis through their centre of pressure; None of
        a single one, whose place tells none.
    """

    finger: Finger
    name: str
    sensor: Sensor
    touched: str | None
    sensor_to_object: Floats
    penetration_m: float
    force_n: Floats
    advanced_m: float
    torque_nm: float | None
    _patches: FacePatches = field(repr=False)
    _see: Callable[[], TouchImage] = field(repr=False)

    @cached_property
    def image(self) -> TouchImage:
        """rgb, depth, mask and contact area, as those of a rigid press at that pose; drawn when asked for."""
        return self._see()

    @property
    def normal_n(self) -> float:
        """Force that presses on the gel, along the sensor's axis; not negative."""
        return max(0.0, -float(self.force_n[0]))

    @property
    def tangential_n(self) -> float:
        """Force across the sensor's axis."""
        return float(np.hypot(*self.force_n[1:]))

    @property
    def sliding(self) -> bool:
        """Whether the force across has reached what friction bears."""
        across = self.tangential_n
        return across > 0 and across >= SLIDING_SHARE * self.finger.friction * self.normal_n

    @cached_property
    def pressed(self) -> Contact:
        """Pressure and displacement of the gel, as an elastic layer under the engine's normal force.

        On cells of `CELL_M` over the gel, see `solve_contact`.

        Raises
        ------
        QueryError
            A force of an object that is not at the gel, or more than the gel bears.
        """
        sensor, normal_n = self.sensor, self.normal_n
        shape = _cells(sensor)
        pitch = sensor.gel_height_m / shape[0], sensor.gel_width_m / shape[1]
        field = gap_field(self._patches, sensor, self.sensor_to_object, shape)
        gap = np.zeros(shape) if normal_n == 0 else field  # where nothing presses there may be no object
        if gap.min() > APART_M:
            finding = f"bears {normal_n:.3g} N of an object that is not at its gel"
            raise QueryError(self.name, finding, "Let collision shapes follow the object's surface.")
        contact = solve_contact(gap, pitch, self._gel, force_n=normal_n, tolerance=CONTACT_TOLERANCE)
        if normal_n > 0 and contact.indentation_m - gap.min() > greatest_depth_m(sensor):
            raise QueryError(self.name, f"bears {normal_n:.3g} N, more than its gel", "Press less.")
        return contact

    @cached_property
    def sheared(self) -> tuple[Contact, Shear]:
        """What `pressed` is, and the traction and displacement along the gel, of nothing before it.

        Raises
        ------
        QueryError
            As `pressed`.
        """
        return self.sheared_after(None)

    def sheared_after(self, before: Shear | None) -> tuple[Contact, Shear]:
        """Return what `sheared` is after the state of an earlier step, of which what slipped stays.

        See `solve_shear`.

        Raises
        ------
        QueryError
            As `pressed`.
        """
        contact = self.pressed
        across = -self.force_n[:0:-1]  # rows descend in z and columns in y
        torque = None if self.torque_nm is None else -self.torque_nm
        return contact, solve_shear(
            contact, self._gel, self.finger.friction, across, torque_nm=torque, before=before,
            tolerance=CONTACT_TOLERANCE,
        )  # fmt: skip

    @property
    def _gel(self) -> Elastomer:
        sensor = self.sensor
        return Elastomer(sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio, sensor.gel_thickness_m)

    def markers(self, grid: tuple[int, int] | None = None, before: Shear | None = None) -> Markers:
        """Return markers on the gel, see `moved_markers`; `before` as of `sheared_after`.

        Raises
        ------
        QueryError
            As `sheared`, or a grid that is none.
        """
        sheared = self.sheared if before is None else self.sheared_after(before)
        return moved_markers(self.sensor, *sheared, grid)


class LiveTouch:
    """Fingers in a simulation, which something else moves on.

    A finger sees the object that lies deepest in its gel, by the surface of its Object File, as `press` under
    the rigid model does at that pose. Forces are those of the engine's contacts in its last step.

    Parameters
    ----------
    simulation
        The engine, see `contacts.Simulation`.
    files
        Object Files by the names of their bodies.
    fingers
        By the names of theirs.
    onto_surface
        An engine's shapes fill what is hollow, and stop a finger before the surface. Where they lie deeper in
        each other at the gel than the surface does, take the sensor on along its axis until the surface lies
        as deep, to 0.1 mm and by 10 mm at most: as deep as the same force presses it into the engine's shape.

    Attributes
    ----------
    sensors
        By the names of fingers, what presses.

    Raises
    ------
    QueryError
        A body that the simulation lacks, no file, a finger of no sensor and files made with different ones.

    Examples
    --------
    >>> import mujoco
    >>> import objectfolder
    >>> from objectfolder.live import Finger, LiveTouch, MujocoSimulation
    >>> model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
    ... <body name="bar"><freejoint/><geom type="box" size=".1 .01 .004"/></body>
    ... <body name="finger" pos="-0.015 0 0.0255" euler="0 90 0"/></worldbody></mujoco>''')
    >>> simulation = MujocoSimulation(model, mujoco.MjData(model))
    >>> touch = LiveTouch(simulation, {"bar": objectfolder.load("bar.safetensors")}, {"finger": Finger()})
    >>> felt = touch.feel()["finger"]
    >>> felt.touched, round(felt.penetration_m, 6), felt.image.rgb.shape
    ('bar', 0.0005, (160, 120, 3))
    """

    def __init__(
        self,
        simulation: Simulation,
        files: Mapping[str, ObjectFile],
        fingers: Mapping[str, Finger],
        *,
        onto_surface: bool = False,
    ) -> None:
        if not files:
            raise QueryError("files", "none given", "Give the Object File of a body.")
        self._simulation, self._fingers, self._onto_surface = simulation, dict(fingers), onto_surface
        for body in (*files, *fingers):
            finite_pose(simulation, body)
        self.sensors = {name: finger.sensor or shared_sensor(files) for name, finger in fingers.items()}
        self._patches = {name: FacePatches(file.surface) for name, file in files.items()}
        self._seers = {
            (body, name): Simulator(patches, self.sensors[name], finger.samples)
            for body, patches in self._patches.items()
            for name, finger in self._fingers.items()
        }

    @hold_forks
    def feel(self) -> dict[str, Felt]:
        """Return what each finger feels now.

        Raises
        ------
        QueryError
            A pose that is not finite, or an object deeper in a gel than that gives way.
        """
        touching = self._simulation.touching()
        return {
            name: self._felt(name, finger, [contact for contact in touching if name in contact.bodies])
            for name, finger in self._fingers.items()
        }

    def _felt(self, name: str, finger: Finger, touching: Sequence[Touching]) -> Felt:
        frame, sensor = finite_pose(self._simulation, name) @ finger.sensor_to_body, self.sensors[name]
        met = {body: [contact for contact in touching if body in contact.bodies] for body in self._patches}
        forces = {body: _force_n(name, met[body]) for body in met}
        candidates = []
        for body in sorted(self._patches, key=lambda body: forces[body] @ frame[:3, 0]):
            at_gel_m = [contact.depth_m for contact in met[body] if _at_gel(sensor, frame, contact.point_m)]
            candidates.append((body, *self._met(body, name, frame, max(at_gel_m, default=0.0))))
        # The first of equals.
        body, pose, near, advanced_m = max(candidates, key=lambda item: item[2].greatest)
        if near.greatest > saturation_depth_m(sensor) + TOLERANCE_M:
            finding = f"{body!r} lies {near.greatest * 1e3:.3g} mm in its gel, deeper than that gives way"
            raise QueryError(name, finding, "Make its contact stiffer, or press less.")
        force, see = sum(forces.values()) @ frame[:3, :3], partial(self._seers[body, name].see, pose, near)
        touched = body if near.greatest > 0 else None
        torque = _torque_nm(name, frame, [contact for each in met.values() for contact in each])
        patches = self._patches[body]
        return Felt(
            finger, name, sensor, touched, pose, near.greatest, force, advanced_m, torque, patches, see
        )

    def _met(self, body: str, name: str, frame: Floats, depth_m: float) -> tuple[Floats, Near, float]:
        """Return a sensor's pose in the frame of a body, its faces near the gel, and how far it was taken on.

        Parameters
        ----------
        frame
            (4, 4) of the sensor, in the world.
        depth_m
            How deep the engine's shapes lie in each other at the gel.
        """
        sensor, seer = self.sensors[name], self._seers[body, name]
        own = np.linalg.inv(finite_pose(self._simulation, body)) @ frame
        near = first = seer.approach(own, 0.0)
        pose, wanted_m, advanced_m = own, depth_m - FOLLOWED_M, 0.0
        if not self._onto_surface or near.greatest >= wanted_m:
            return own, near, 0.0
        for _ in range(2):  # cells miss the deepest place by some micrometres
            least_m = -near.greatest
            if not near.greatest > 0:
                least_m = float(gap_field(self._patches[body], sensor, pose, _cells(sensor)).min())
            advanced_m += wanted_m + least_m
            if not 0 < advanced_m <= FARTHEST_M:
                return own, first, 0.0
            pose = own.copy()
            pose[:3, 3] += advanced_m * own[:3, 0]
            near = seer.approach(pose, 0.0)
        return pose, near, advanced_m


def _cells(sensor: Sensor) -> tuple[int, int]:
    """Return rows and columns of `CELL_M` over a gel."""
    return round(sensor.gel_height_m / CELL_M), round(sensor.gel_width_m / CELL_M)


def _at_gel(sensor: Sensor, frame: Floats, point_m: Floats) -> bool:
    """Whether a point (3,) of the world lies over the gel of a sensor at a frame (4, 4), or nearly so."""
    beside = np.abs((point_m - frame[:3, 3]) @ frame[:3, 1:3] - sensor.gel_apex_m[1:])
    return bool((beside <= np.array([sensor.gel_width_m, sensor.gel_height_m]) / 2 + BESIDE_M).all())


def _force_n(name: str, touching: Sequence[Touching]) -> Floats:
    """Return the force (3,) of contacts on one of their bodies, in the world."""
    force = np.zeros(3)
    for contact in touching:
        force += (1.0 if contact.bodies[1] == name else -1.0) * (
            contact.force_n * contact.normal + contact.friction_n
        )
    return force


def _torque_nm(name: str, frame: Floats, touching: Sequence[Touching]) -> float | None:
    """Return the torque that `Felt.torque_nm` is, of a sensor at a frame (4, 4) of the world."""
    forces = np.array([_force_n(name, [contact]) for contact in touching]).reshape(-1, 3) @ frame[:3, :3]
    bearing = np.maximum(-forces[:, 0], 0.0)
    if np.count_nonzero(bearing) < 2:
        return None
    points = (np.array([contact.point_m for contact in touching]) - frame[:3, 3]) @ frame[:3, 1:3]
    y, z = (points - bearing @ points / bearing.sum()).T
    return float(np.sum(y * forces[:, 2] - z * forces[:, 1]))
