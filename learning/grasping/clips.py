"""Clips of grasps that hold and of grasps that do not: what is seen, what is heard, what both gels feel.

Each is done twice: first to learn what comes of it, then to be filmed. Both times the same happens.
"""

from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from learning.grasping.touch_policy import TEST, Grasps, feeling
from learning.grasping.world import LIFT_M, Act, Grasp, World, drawn_grasps
from learning.runs import Objects
from learning.settings import Settings
from objectfolder.errors import QueryError
from objectfolder.live import Felt, LiveSight, LiveSound, MujocoSimulation
from objectfolder.live.clip import AUDIO_RATE_HZ, FRAMES_PER_S, beside, write_clip
from objectfolder.live.gripper import FINGERS, shown_finger
from objectfolder.object_file import ObjectFile
from objectfolder.products.provenance import seed_from
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG, look_at

FOLDER, TASKS = Path("reports/clips"), ("grasping", "regrasping")
HELD, LOST = "held", "lost"
EACH, MOST_TRIED = 5, 500  # clips of an outcome; tries among which they are looked for
FROM = np.array([1.0, -0.35, 0.6])  # the camera stands that way from the object, beside the fingers' way
AFTER_S = 0.7  # that a clip goes on when the fingers have been lifted


class Tried(NamedTuple):
    """Where fingers closed on an object one after the other, before they lifted it, and what came of it."""

    object_id: str
    grasps: list[Grasp]
    held: bool


def write_clips(objects: Objects, settings: Settings, folder: Path = FOLDER) -> list[Path]:
    """Write `EACH` clips of each outcome of grasping and of regrasping, and return where they are.

    There are fewer of an outcome where fewer of `MOST_TRIED` come to it.
    """
    grasps = Grasps(objects, settings)
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.mp4"):
        old.unlink()
    written = []
    for task, tries in zip(TASKS, (_grasped, _regrasped), strict=True):
        counts = {HELD: 0, LOST: 0}
        for _, attempt in zip(range(MOST_TRIED), tries(grasps, objects, settings), strict=False):
            outcome = HELD if attempt.held else LOST
            if counts[outcome] < EACH:
                counts[outcome] += 1
                path = folder / f"{task}_{outcome}_{counts[outcome]}_{attempt.object_id}.mp4"
                write_film(
                    path, grasps.worlds[attempt.object_id], objects.files[attempt.object_id], attempt.grasps
                )
                written.append(path)
            if min(counts.values()) == EACH:
                break
    return written


def clips_in(folder: Path) -> dict[str, list[str]]:
    """Return the names of the clips of each task that a folder has, of what was held first."""
    return {task: sorted(path.name for path in folder.glob(f"{task}_*.mp4")) for task in TASKS}


def _grasped(grasps: Grasps, objects: Objects, settings: Settings) -> Iterator[Tried]:
    """Yield grasps as those that stability is learnt from, of each object in turn."""
    seeds = {name: seed_from(settings.seeds[0], "clips", name) for name in grasps.ids}
    streams = {name: drawn_grasps(objects.files[name], seed) for name, seed in seeds.items()}
    for number in count():
        name = grasps.ids[number % len(grasps.ids)]
        grasp = next(streams[name])
        try:
            outcome = grasps.worlds[name].attempt(grasp, settings.data.resolution.vision)
        except QueryError:  # the gels cannot show it
            continue
        yield Tried(name, [grasp], outcome.held)


def _regrasped(grasps: Grasps, objects: Objects, settings: Settings) -> Iterator[Tried]:
    """Yield episodes of the test, by the policy of the first seed if it was learnt, else by `feeling`."""
    parameters = settings.regrasping
    act = grasps.known(parameters.seeds[0]) or feeling
    environment = grasps.environment(parameters.force_share, parameters.spread_m)
    for seed in count(TEST):
        observed, info = environment.reset(seed=seed)
        closed, over, random = [environment.grasp], False, np.random.default_rng([seed, 1])
        while not over:
            before = info["regrasps"]
            observed, _, over, _, info = environment.step(act(observed, before, random))
            if info["regrasps"] > before:
                closed.append(environment.grasp)
        yield Tried(info["object"], closed, info["is_success"])


def write_film(path: Path, world: World, file: ObjectFile, grasps: list[Grasp]) -> None:
    """Write a clip of fingers that close on an object, again elsewhere, and lift it at the last."""
    pixels = _pixels(file)
    write_clip(path, filmed(world, file, grasps), (pixels, pixels + file.touch.sensor.image_width))


def _pixels(file: ObjectFile) -> int:
    """Return the side of the camera's image, beside both gels."""
    return 2 * file.touch.sensor.image_height


def filmed(
    world: World, file: ObjectFile, grasps: list[Grasp]
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.float64]]]:
    """Yield images and sounds as of `recorded`; each grasp begins with a cut, for the object is put back."""
    sensor = file.touch.sensor
    gel_matter = sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio  # beside the table
    fingers = {name: shown_finger(sensor) for name in FINGERS}
    sight = LiveSight(world.simulation, {"object": file}, matt=fingers)
    world.place(grasps[0])
    camera = _camera(world, file)
    for grasp in grasps:
        world.place(grasp)
        simulation: Any = _Acted(world.simulation, _acts(world, grasp, lifts=grasp is grasps[-1]))
        sound = LiveSound(
            simulation, {"object": file}, listener_m=tuple(camera[:3, 3]),
            known=dict.fromkeys(FINGERS, gel_matter), block_samples=AUDIO_RATE_HZ // FRAMES_PER_S,
        )  # fmt: skip
        gels = [np.full((sensor.image_height, sensor.image_width, 3), 128, dtype=np.uint8)] * 2
        while not simulation.over:
            gels = _gels(world, gels)
            image, block = sight.image(camera, _pixels(file)).rgb, sound.block()
            # What rings on where the film is cut is faded, or it would click.
            yield beside(image, gels), block * np.linspace(1, 0, len(block)) if simulation.over else block


def _acts(world: World, grasp: Grasp, lifts: bool) -> Act:
    yield from world.closing(grasp.force_n)
    if lifts:
        yield from world.lifting(grasp.force_n)
        yield from world.holding(AFTER_S, grasp.force_n)


def _camera(world: World, file: ObjectFile) -> NDArray[np.float64]:
    """Return a pose from which the object is seen where it stands and where it is lifted to."""
    pose = world.simulation.pose("object")
    points = file.surface.vertices @ pose[:3, :3].T + pose[:3, 3]
    low, high = points.min(axis=0), points.max(axis=0)
    high[2] += LIFT_M
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    away = radius / np.sin(np.deg2rad(FIELD_OF_VIEW_DEG) / 2)
    camera: NDArray[np.float64] = look_at(middle + away * FROM / np.linalg.norm(FROM), middle)[0]
    return camera


def _gels(world: World, before: list[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
    """Return what both gels show, as before where the object lies deeper in one than that gives way."""
    try:
        return [_gel_image(felt) for felt in world.feel().values()]
    except QueryError:
        return before


def _gel_image(felt: Felt) -> NDArray[np.uint8]:
    """Return a gel's image, with its markers if they are known."""
    try:
        return felt.markers().drawn_on(felt.image.rgb)
    except QueryError:
        return felt.image.rgb


class _Acted:
    """A simulation in which fingers act as it runs.

    Attributes
    ----------
    over
        Whether it has run on after the act.
    """

    def __init__(self, simulation: MujocoSimulation, act: Act) -> None:
        self._simulation, self._act, self.over = simulation, act, False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._simulation, name)

    def step(self) -> None:
        self.over = next(self._act, self) is self
        self._simulation.step()
