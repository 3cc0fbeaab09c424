"""A scene of MuJoCo with the Object Files beside it."""

import contextlib
import re
import resource
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder import load
from objectfolder.errors import InputError
from objectfolder.extras import needs_extra
from objectfolder.live.contacts import Posed
from objectfolder.live.matt_body import MattBody
from objectfolder.live.scene_view import moved_by
from objectfolder.live.sight import LiveSight
from objectfolder.object_file import ObjectFile
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG, look_at
from objectfolder.vision.lamps import Lamps
from pipeline.publish.scenes.scene_bounds import check_scene

VIEWED_FROM = np.array([0.15, -1.0, 0.65])  # from the middle of the objects towards the camera
CAMERA_MARGIN = 1.06  # of the camera's distance, over that at which objects just fit
# Names in a scene's MJCF: its lamps' begin with that; the texts that name its environment, and whether its
# table is of wood before a soft backdrop.
LAMP, ENVIRONMENT, SURROUNDINGS_TEXT = "lamp", "environment", "surroundings"
WARM = "warm"
SHORTEST_STEP_S, LONGEST_STEP_S = 1e-5, 0.1
FILE_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,99}")  # of an Object File, without its suffix
MOST_MEMORY_BYTES = 2 << 30  # that MuJoCo may take for a scene


@dataclass(frozen=True)
class OpenedScene:
    """A scene and the files of its bodies.

    Parameters
    ----------
    spec, model
        `mujoco.MjSpec` and the `mujoco.MjModel` that it makes.
    files
        By the names of the bodies.
    """

    spec: Any
    model: Any
    files: dict[str, ObjectFile]

    @classmethod
    def of(cls, scene: Path) -> "OpenedScene":
        """Open MJCF as ``objectfolder scene`` writes it: body ``0_mug`` has its file in mug/mug.safetensors.

        Raises
        ------
        InputError
            No scene of MuJoCo, or one that asks for too much (`scene_bounds`); no object in
            it, an object without its file.
        MissingPackageError
            MuJoCo is not installed.
        """
        with needs_extra("video"):
            import mujoco
        check_scene(scene)
        try:
            with _memory_bounded():
                spec = mujoco.MjSpec.from_file(str(scene))
                model = spec.compile()
        except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
            finding = f"no scene of MuJoCo: {' '.join(str(error).split())}"
            raise InputError(str(scene), finding, "Make one: objectfolder scene.") from error
        options = [model.opt.timestep, *model.opt.gravity, *model.opt.wind, model.opt.density]
        if not (np.isfinite(options).all() and SHORTEST_STEP_S <= model.opt.timestep <= LONGEST_STEP_S):
            finding = f"its time steps ({model.opt.timestep:g} s) or its forces are not of this world"
            remedy = f"Give <option> a timestep of {SHORTEST_STEP_S:g} to {LONGEST_STEP_S:g} s."
            raise InputError(str(scene), finding, remedy)
        return cls(spec, model, _files(scene, model))

    def points(self, simulation: Posed) -> np.ndarray:
        """Return the vertices (n, 3) of all objects as they are now."""
        return np.concatenate(
            [moved_by(simulation.pose(name), file.surface.vertices) for name, file in self.files.items()]
        )

    def sight(self, simulation: Posed, matt: Mapping[str, MattBody] | None = None) -> LiveSight:
        """Return what is seen of it and of matt bodies, under the lights that it says.

        Raises
        ------
        QueryError
            Another environment than `ObjectFile.render` knows.
        """
        stated = [self.model.light(number) for number in range(self.model.nlight)]
        lamps = [light for light in stated if light.name.startswith(LAMP)]
        texts = {text.name: text.data for text in self.spec.texts}
        lights: list[Lamps | str] = [texts[ENVIRONMENT]] if ENVIRONMENT in texts else []
        if lamps:
            places, colours = ([getattr(lamp, key) for lamp in lamps] for key in ("pos", "diffuse"))
            lights.append(Lamps(np.array(places), np.array(colours, np.float64)))
        warm = texts.get(SURROUNDINGS_TEXT) == WARM
        return LiveSight(
            simulation, self.files, matt=matt, lights=lights or None, table_m=self.table_m, warm=warm
        )

    @property
    def table_m(self) -> tuple[float, float] | None:
        """Side and height of its table; None where no geometry has that name."""
        names = [self.model.geom(number).name for number in range(self.model.ngeom)]
        if "table" not in names:
            return None
        table = self.model.geom("table")
        return 2 * float(table.size[0]), float(table.pos[2] + table.size[2])


@contextlib.contextmanager
def _memory_bounded() -> Iterator[None]:
    """Let this process take `MOST_MEMORY_BYTES` more while the context lasts."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + MOST_MEMORY_BYTES
    if before[1] != resource.RLIM_INFINITY:
        limit = min(limit, before[1])
    resource.setrlimit(resource.RLIMIT_AS, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def framed(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the centre (3,) and radius of the ball that fills the image in which points (n, 3) just fit.

    The image is seen from `VIEWED_FROM`.
    """
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    turn = look_at(middle + VIEWED_FROM, middle)[0][:3, :3]
    x, y, towards = ((points - middle) @ turn).T
    half = np.deg2rad(FIELD_OF_VIEW_DEG) / 2
    away = float((towards + np.maximum(abs(x), abs(y)) / np.tan(half)).max())
    return middle, away * float(np.sin(half))


def camera_over(points: np.ndarray) -> np.ndarray:
    """Return a pose from which points (n, 3) are seen, with little beside them."""
    middle, radius = framed(points)
    away = CAMERA_MARGIN * radius / np.sin(np.deg2rad(FIELD_OF_VIEW_DEG) / 2)
    pose: np.ndarray = look_at(middle + away * VIEWED_FROM / np.linalg.norm(VIEWED_FROM), middle)[0]
    return pose


def _files(scene: Path, model: Any) -> dict[str, ObjectFile]:
    files = {}
    for number in range(1, model.nbody):
        body = model.body(number).name
        name = body.partition("_")[2]
        path = scene.parent / name / f"{name}.safetensors"
        if not FILE_NAME.fullmatch(name) or not path.is_file():
            remedy = f"Put its Object File there: {path}."
            raise InputError(str(scene), f"body {body!r} has no Object File beside the scene", remedy)
        files[body] = load(path)
    if not files:
        raise InputError(str(scene), "no object stands in it", "Make a scene: objectfolder scene mug bell.")
    return files
