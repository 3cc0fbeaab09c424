"""A scene of MuJoCo with the Object Files beside it, played to a video."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.audio.synthesis.wav import listening_gain
from objectfolder.live import LiveSound, MujocoSimulation, Simulation
from objectfolder.live.clip import AUDIO_RATE_HZ, FRAMES_PER_S, recorded, write_clip
from objectfolder.live.simulators import OWN, open_simulation
from pipeline.publish.scenes.opened_scene import OpenedScene, camera_over

MOST_TURN_RAD = 0.6


@dataclass(frozen=True)
class ClipSummary:
    """A video, the collisions in it, their peak at the camera, and the gain by which they were written."""

    file: str
    collisions: int
    peak_pa: float
    gain: float

    def __str__(self) -> str:
        peak = f"peak {self.peak_pa:.3g} Pa at the camera"
        collisions = f"{self.collisions} collision{'' if self.collisions == 1 else 's'}"
        return f"{self.file}: {collisions}, {peak}, times {self.gain:.3g}"


def play(
    scene: Path,
    output: Path,
    seconds: float,
    lift_m: float,
    resolution: tuple[int, int],
    seed: int,
    simulator: str = OWN[0],
) -> ClipSummary:
    """Drop the objects of a scene, and write what is seen and heard.

    Parameters
    ----------
    scene
        As for `OpenedScene.of`.
    lift_m
        How far objects are lifted at first, and up to twice as far; 0 leaves them as they stand.
    seed
        Of heights, turns and rough surfaces.
    simulator
        ``"mujoco"``, or that of a plugin.

    Raises
    ------
    InputError
        A scene that cannot be opened; no such simulator.
    """
    content = OpenedScene.of(scene)
    import mujoco  # which is there, then

    model, files = content.model, content.files
    data = mujoco.MjData(model)
    _lift(model, data, lift_m, np.random.default_rng(seed))
    simulation: Simulation = MujocoSimulation(model, data)
    if simulator not in OWN:
        simulation = open_simulation(simulator, scene, {name: simulation.pose(name) for name in files})
    standing = content.points(MujocoSimulation(model, mujoco.MjData(model)))
    camera = camera_over(np.concatenate([standing, content.points(simulation)]))
    sound = LiveSound(
        simulation,
        files,
        listener_m=tuple(camera[:3, 3]),
        seed=seed,
        block_samples=AUDIO_RATE_HZ // FRAMES_PER_S,
    )
    frames = recorded(sound, content.sight(simulation), camera, seconds, resolution)
    peak_pa = write_clip(output, frames, resolution)
    return ClipSummary(str(output), len(sound.impacts), float(peak_pa), float(listening_gain(peak_pa)))


def _lift(model: Any, data: Any, lift_m: float, random: np.random.Generator) -> None:
    import mujoco
    from scipy.spatial.transform import Rotation

    free = mujoco.mjtJoint.mjJNT_FREE
    for joint in range(model.njnt):
        if lift_m <= 0 or model.jnt_type[joint] != free:
            continue
        at = model.jnt_qposadr[joint]
        data.qpos[at + 2] += lift_m * (1 + random.random())
        rotation = Rotation.from_quat(np.roll(data.qpos[at + 3 : at + 7], -1))
        turn = Rotation.from_rotvec(random.uniform(-MOST_TURN_RAD, MOST_TURN_RAD, 3))
        data.qpos[at + 3 : at + 7] = np.roll((turn * rotation).as_quat(), 1)
