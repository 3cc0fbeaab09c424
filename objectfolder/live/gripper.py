"""Two tactile fingers round an object that stands on the ground, as a model of MuJoCo."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from objectfolder.extras import needs_extra
from objectfolder.live.matt_body import MattBody
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.surface.surface import Surface
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor

FINGERS = ("left", "right")
BALL_M = 0.0325  # radius of a DIGIT's gel at its apex
OPENING_M, HIGHEST_M = 0.004, 0.2  # between object and gel, on each side; that fingers are lifted
# Controls: newtons with which left and right close, and metres a second at which they are lifted.
MOTORS = "".join(f'<motor joint="{name}_close"/>' for name in FINGERS) + "".join(
    f'<intvelocity joint="{name}_lift" kp="2000" actrange="0 {HIGHEST_M}"/>' for name in FINGERS
)


def fingers(place_m: tuple[float, float], starts_m: tuple[float, float], friction: float = 0.8) -> str:
    """Return two DIGITs in MJCF, bodies `FINGERS` in the sensors' frames, which close along y and are lifted.

    Parameters
    ----------
    place_m
        Their x and z.
    starts_m
        Their y at first.
    friction
        Of gels and objects.
    """
    apex, _, middle = Sensor().gel_apex_m
    return "".join(
        f'<body name="{name}" pos="{place_m[0]} {y} {place_m[1]}" euler="0 0 {turn}" gravcomp="1">'
        f'<joint name="{name}_close" type="slide" axis="1 0 0" damping="20"/>'
        f'<joint name="{name}_lift" type="slide" axis="0 0 1" damping="20"/>'
        f'<geom type="sphere" size="{BALL_M}" pos="{apex - BALL_M} 0 {middle}" mass=".1" condim="4"'
        f' friction="{friction}" priority="1" solref="-9000 -150"/></body>'
        for name, y, turn in zip(FINGERS, starts_m, (90, -90), strict=True)
    )


def shown_finger() -> MattBody:
    """Return what is seen of a DIGIT: the hull of its housing and its gel, in the sensor's frame.

    Its contacts are those of a ball with the gel's curvature, see `fingers`.
    """
    sensor = Sensor()
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
    file: ObjectFile, friction: float = 0.8, timestep_s: float = 0.002, hulls: Sequence[Surface] = ()
) -> Any:
    """Return a `mujoco.MjModel` of an object between two DIGITs.

    Bodies are ``object`` and `FINGERS`, whose frames are their sensors'. The fingers close along y beside the
    centre of mass, by `MOTORS`, and pass through the ground, so that they reach what is flat.

    Parameters
    ----------
    friction
        Of fingers and object.
    hulls
        The object's convex parts, object frame; its convex hull by default.
    """
    (low, high), apex = file.surface.bounds, Sensor().gel_apex_m
    place = file.description["body"]["centre_of_mass_m"][0], (high[2] - low[2]) / 2 - apex[2]
    starts = low[1] - OPENING_M - apex[0], high[1] + OPENING_M + apex[0]
    return standing(file, timestep_s, fingers(place, starts, friction), MOTORS, hulls, through=FINGERS)


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
    (low, _), known = file.surface.bounds, file.description["body"]
    (a, d, e), (_, b, f), (_, _, c) = known["inertia_kg_m2"]
    whole = file.surface.vertices
    parts = [hull.vertices for hull in hulls] or [whole[ConvexHull(whole).vertices]]
    meshes = "".join(f'<mesh name="{i}" vertex="{_told(part.ravel())}"/>' for i, part in enumerate(parts))
    shapes = "".join(f'<geom type="mesh" mesh="{i}"/>' for i in range(len(parts)))
    passing = "".join(f'<exclude body1="world" body2="{name}"/>' for name in through)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep_s}" cone="elliptic" impratio="10"/>'
        f"<asset>{meshes}</asset><worldbody>"
        f'<geom type="plane" size="1 1 .1"/>{bodies}<body name="object" pos="0 0 {-low[2]}"><freejoint/>'
        f'<inertial pos="{_told(known["centre_of_mass_m"])}" mass="{known["mass_kg"]}"'
        f' fullinertia="{_told([a, b, c, d, e, f])}"/>{shapes}</body></worldbody>'
        f"<contact>{passing}</contact><actuator>{motors}</actuator></mujoco>"
    )


def _told(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(np.float64(number))) for number in numbers)
