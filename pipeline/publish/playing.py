"""A scene of MuJoCo with the Object Files beside it, played to a video."""

from pathlib import Path
from typing import Any

import numpy as np

from objectfolder import load
from objectfolder.audio.synthesis.wav import listening_gain
from objectfolder.errors import InputError
from objectfolder.live import LiveSight, LiveSound, MujocoSimulation
from objectfolder.live.clip import FRAMES_PER_S, SAMPLE_RATE_HZ, recorded, write_clip
from objectfolder.object_file import ObjectFile
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG, look_at

# From the middle of the objects towards the camera; what is seen beside the objects' own places.
VIEWED_FROM, ROOM_M = np.array([0.15, -1.0, 0.65]), 0.13
MOST_TURN_RAD = 0.6
INSTALL = "pip install 'objectfolder-factory[video]'"


def play(
    scene: Path, output: Path, seconds: float, lift_m: float, resolution: tuple[int, int], seed: int
) -> str:
    """Drop the objects of a scene, write what is seen and heard, and say what was heard.

    Parameters
    ----------
    scene
        MJCF as ``objectfolder scene`` writes it: body ``0_mug`` has its Object File in mug/mug.safetensors.
    lift_m
        How far objects are lifted at first, and up to twice as far; 0 leaves them as they stand.
    seed
        Of heights, turns and rough surfaces.

    Raises
    ------
    InputError
        No scene of MuJoCo, no object in it, an object without its file; MuJoCo is not installed.
    """
    try:
        import mujoco
    except ImportError as error:
        raise InputError(str(scene), "MuJoCo is not installed", INSTALL) from error
    try:
        model = mujoco.MjModel.from_xml_path(str(scene))
    except ValueError as error:
        raise InputError(
            str(scene), f"no scene of MuJoCo: {error}", "Make one: objectfolder scene."
        ) from error
    data = mujoco.MjData(model)
    _lift(model, data, lift_m, np.random.default_rng(seed))
    simulation, files = MujocoSimulation(model, data), _files(scene, model)
    places = np.array([simulation.pose(name)[:3, 3] for name in files])
    camera = _camera(places)
    sound = LiveSound(
        simulation,
        files,
        listener_m=tuple(camera[:3, 3]),
        seed=seed,
        block_samples=SAMPLE_RATE_HZ // FRAMES_PER_S,
    )
    sight = LiveSight(simulation, files, table_m=_table(model))
    shown = recorded(sound, sight, camera, seconds, resolution)
    peak_pa = write_clip(output, shown, resolution)
    gain = listening_gain(peak_pa)
    return f"{output}: {len(sound.impacts)} collisions, peak {peak_pa:.3g} Pa at the camera, times {gain:.3g}"


def _lift(model: Any, data: Any, lift_m: float, random: np.random.Generator) -> None:
    import mujoco
    from scipy.spatial.transform import Rotation

    free = mujoco.mjtJoint.mjJNT_FREE
    for joint in range(model.njnt):
        if lift_m <= 0 or model.jnt_type[joint] != free:
            continue
        at = model.jnt_qposadr[joint]
        data.qpos[at + 2] += lift_m * (1 + random.random())
        turned = Rotation.from_quat(np.roll(data.qpos[at + 3 : at + 7], -1))
        turn = Rotation.from_rotvec(random.uniform(-MOST_TURN_RAD, MOST_TURN_RAD, 3))
        data.qpos[at + 3 : at + 7] = np.roll((turn * turned).as_quat(), 1)


def _files(scene: Path, model: Any) -> dict[str, ObjectFile]:
    files = {}
    for number in range(1, model.nbody):
        body = model.body(number).name
        name = body.partition("_")[2]
        path = scene.parent / name / f"{name}.safetensors"
        if not path.is_file():
            remedy = f"Put its Object File there: {path}."
            raise InputError(str(scene), f"body {body!r} has no Object File beside the scene", remedy)
        files[body] = load(path)
    if not files:
        raise InputError(str(scene), "no object stands in it", "Make a scene: objectfolder scene mug bell.")
    return files


def _camera(places: np.ndarray) -> np.ndarray:
    """Return a pose from which objects at places (n, 3) are seen."""
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    reach = float(np.linalg.norm(places - middle, axis=1).max()) + ROOM_M
    away = reach / np.tan(np.deg2rad(FIELD_OF_VIEW_DEG) / 2)
    pose: np.ndarray = look_at(middle + away * VIEWED_FROM / np.linalg.norm(VIEWED_FROM), middle)[0]
    return pose


def _table(model: Any) -> tuple[float, float] | None:
    names = [model.geom(number).name for number in range(model.ngeom)]
    if "table" not in names:
        return None
    table = model.geom("table")
    return 2 * float(table.size[0]), float(table.pos[2] + table.size[2])
