"""Two tactile fingers round an object that stands on the ground, as a model of MuJoCo."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from objectfolder.extras import needs_extra
from objectfolder.live.matt_body import MattBody
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.surface.surface import Surface
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor

Floats = NDArray[np.float64]
FINGERS = ("left", "right")
LARGEST_BALL_M = 0.1  # a larger one would be met far beside its gel
OPENING_M, HIGHEST_M = 0.004, 0.2  # between object and gel, on each side; that fingers are lifted
# Controls: newtons with which left and right close, and metres a second at which they are lifted.
MOTORS = "".join(f'<motor joint="{name}_close"/>' for name in FINGERS) + "".join(
    f'<intvelocity joint="{name}_lift" kp="2000" actrange="0 {HIGHEST_M}"/>' for name in FINGERS
)


def recess_m(sensor: Sensor, y: Floats, z: Floats) -> Floats:
    """Return how far (n,) a finger's shape lies behind its apex at places (n,) from that; infinite beside it.

    The shape is a ball as round as the gel, or a box where the gel is nearly flat.
    """
    ball, away = _ball_m(sensor), np.hypot(y, z)
    if np.isfinite(ball):
        return np.where(away < ball, ball - np.sqrt(np.maximum(ball**2 - away**2, 0.0)), np.inf)
    over = (np.abs(y) < sensor.gel_width_m / 2) & (np.abs(z) < sensor.gel_height_m / 2)
    return np.where(over, 0.0, np.inf)


def _ball_m(sensor: Sensor) -> float:
    """Return the radius of a gel's curvature, infinite where it is nearly flat."""
    corner_squared = (sensor.gel_width_m**2 + sensor.gel_height_m**2) / 4
    radius = corner_squared / (2 * sensor.gel_sagitta_m) if sensor.gel_sagitta_m else np.inf
    return round(radius, 9) if radius <= LARGEST_BALL_M else np.inf


def _shape(sensor: Sensor) -> str:
    """Return type, size and place of `recess_m`'s shape in MJCF."""
    (apex, y, z), ball = sensor.gel_apex_m, _ball_m(sensor)
    if np.isfinite(ball):
        return f'type="sphere" size="{ball}" pos="{apex - ball} {y} {z}"'
    deep = (apex - sensor.housing_low_m[0]) / 2
    size = f"{deep} {sensor.gel_width_m / 2} {sensor.gel_height_m / 2}"
    return f'type="box" size="{size}" pos="{apex - deep} {y} {z}"'


def fingers(
    place_m: tuple[float, float], starts_m: tuple[float, float], sensor: Sensor, friction: float = 0.8
) -> str:
    """Return two sensors in MJCF, bodies `FINGERS` in their frames, which close along y and are lifted.

    Parameters
    ----------
    place_m
        Their x and z.
    starts_m
        Their y at first.
    sensor
        Whose gel their shape has, see `recess_m`.
    friction
        Of gels and objects.
    """
    return "".join(
        f'<body name="{name}" pos="{place_m[0]} {y} {place_m[1]}" euler="0 0 {turn}" gravcomp="1">'
        f'<joint name="{name}_close" type="slide" axis="1 0 0" damping="20"/>'
        f'<joint name="{name}_lift" type="slide" axis="0 0 1" damping="20"/>'
        f'<geom {_shape(sensor)} mass=".1" condim="4" friction="{friction}" priority="1"'
        f' solref="-9000 -150"/></body>'
        for name, y, turn in zip(FINGERS, starts_m, (90, -90), strict=True)
    )


def shown_finger(sensor: Sensor) -> MattBody:
    """Return what is seen of a sensor: the hull of its housing and its gel, in the sensor's frame.

    Its contacts are those of another shape, see `recess_m`.
    """
    across = np.linspace(-0.5, 0.5, 9)
    y, z = np.meshgrid(across * sensor.gel_width_m, sensor.gel_apex_m[2] + across * sensor.gel_height_m)
    gel = np.stack([gel_surface(sensor, y, z), y, z], axis=-1).reshape(-1, 3)
    box = np.stack(
        np.meshgrid(*zip(sensor.housing_low_m, sensor.housing_high_m, strict=True)), axis=-1
    ).reshape(-1, 3)
    hull = ConvexHull(np.concatenate([gel, box]))
    corners = hull.points[hull.simplices]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = (sides * hull.equations[:, :3]).sum(axis=1) < 0
    faces = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    return MattBody(Surface(hull.points, faces))


def gripper(
    file: ObjectFile,
    friction: float = 0.8,
    timestep_s: float = 0.002,
    hulls: Sequence[Surface] = (),
    sensor: Sensor | None = None,
) -> Any:
    """Return a `mujoco.MjModel` of an object between two tactile sensors.

    Bodies are ``object`` and `FINGERS`, whose frames are their sensors'. The fingers close along y beside the
    centre of mass, by `MOTORS`, and pass through the ground, so that they reach what is flat.

    Parameters
    ----------
    friction
        Of fingers and object.
    hulls
        The object's convex parts, object frame; its convex hull by default.
    sensor
        What presses; the one that the file was made with if None.
    """
    sensor = sensor or file.touch.sensor
    (low, high), apex = file.surface.bounds, sensor.gel_apex_m
    place = file.description["body"]["centre_of_mass_m"][0], (high[2] - low[2]) / 2 - apex[2]
    starts = low[1] - OPENING_M - apex[0], high[1] + OPENING_M + apex[0]
    return standing(
        file, timestep_s, fingers(place, starts, sensor, friction), MOTORS, hulls, through=FINGERS
    )


def standing(
    file: ObjectFile,
    timestep_s: float = 0.002,
    bodies: str = "",
    motors: str = "",
    hulls: Sequence[Surface] = (),
    through: Sequence[str] = (),
) -> Any:
    """Return a `mujoco.MjModel` of an object, body ``object``, on the ground beside other bodies in MJCF.

    Parameters
    ----------
    hulls
        Its convex parts, object frame; its convex hull by default.
    through
        Bodies that pass through the ground.
    """
    with needs_extra("mujoco"):
        import mujoco
    (low, _), body = file.surface.bounds, file.description["body"]
    (a, d, e), (_, b, f), (_, _, c) = body["inertia_kg_m2"]
    whole = file.surface.vertices
    parts = [hull.vertices for hull in hulls] or [whole[ConvexHull(whole).vertices]]
    meshes = "".join(f'<mesh name="{i}" vertex="{_text(part.ravel())}"/>' for i, part in enumerate(parts))
    shapes = "".join(f'<geom type="mesh" mesh="{i}"/>' for i in range(len(parts)))
    passing = "".join(f'<exclude body1="world" body2="{name}"/>' for name in through)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep_s}" cone="elliptic" impratio="10"/>'
        f"<asset>{meshes}</asset><worldbody>"
        f'<geom type="plane" size="1 1 .1"/>{bodies}<body name="object" pos="0 0 {-low[2]}"><freejoint/>'
        f'<inertial pos="{_text(body["centre_of_mass_m"])}" mass="{body["mass_kg"]}"'
        f' fullinertia="{_text([a, b, c, d, e, f])}"/>{shapes}</body></worldbody>'
        f"<contact>{passing}</contact><actuator>{motors}</actuator></mujoco>"
    )


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(np.float64(number))) for number in numbers)
