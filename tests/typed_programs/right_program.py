"""A program of a user, which a strict type checker accepts."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import objectfolder
from objectfolder import Environment, Lamps, ObjectFile, ObjectFolderError, Press, Sound, Touches


def describe(file: ObjectFile) -> str:
    mass = "unknown" if file.mass_kg is None else f"{file.mass_kg:.3f} kg"
    low, high = file.bounds_m
    return f"{file.name}: {file.material or 'unknown'}, {mass}, {high - low} m, {file.length_m:.3f} m"


def look(file: ObjectFile) -> NDArray[np.uint8]:
    cameras, lights = file.sample_views(2, seed=1)
    images = file.render(cameras, lights, resolution=(48, 64), field_of_view_deg=30.0)
    red = file.render(cameras, Lamps(lights, colours=(1.0, 0.0, 0.0)), 64)
    sky = file.sight.render(cameras, "sky", 64, sub_rays=4)
    around = file.render(cameras, Environment.of(np.ones((4, 8, 3))), crop=(0, 0, 8, 8))
    radiance: NDArray[np.float32] = file.render_linear(cameras, lights, 64)
    depth = file.render_passes(cameras, ["depth", "mask"], lights, 64)["depth"]
    rgba = file.radiance([[0.0, 0.0, 1.0]], [[0.0, 0.0, -1.0]], [0.0, 0.0, 1.0])
    print(red.shape, sky.shape, around.shape, radiance.mean(), depth.min(), rgba[:, 3])
    return images


def listen(file: ObjectFile, folder: Path) -> Sound:
    points, normals = file.sample_contacts(3)
    sound = file.strike(points, duration_s=1.0, sample_rate_hz=48000)
    hard = file.sound.strike(points, -2 * normals, pulse=1e-3, listener=(0.3, 0.0, 0.4))
    pushed = file.strike(points[0], forces_n=np.ones((1, 100, 3)), modes=8)
    for rows, part in file.strikes(points, duration_s=0.1):
        print(rows.start, part.shape)
    stream = file.stream(48000)
    stream.strike(points[0], -0.1 * normals[0], at=100)
    print(stream.block(512).shape, hard.shape, pushed.shape, file.mode_velocities(points, -normals).shape)
    sound[0].write(folder / "strike.wav")
    return sound


def feel(file: ObjectFile) -> Touches:
    points, _ = file.sample_contacts(3, reachable=False)
    touches = file.press(points, depth_m=0.001, tilt_deg=5.0, roll_deg=np.array([0.0, 5.0, 10.0]))
    hard = file.touch.press(points, force_n=2.0, resolution=(80, 60), noise_seed=1)
    rigid = file.touch.net.press(points, Press(depth_m=0.0005))
    fits: NDArray[np.bool_] = file.reach(points, rolls=12).at_some_roll
    print(touches[0].rgb.shape, len(hard), rigid[1:].force_n, fits, file.touch.sensor.maximum_depth_m)
    return touches[touches.reachable]


def main() -> None:
    mug = objectfolder.example("mug")
    print(describe(mug), look(mug).dtype, listen(mug, Path(".")).sample_rate_hz, len(feel(mug)))
    try:
        built = objectfolder.build("mug.obj", material="ceramic", length_m=0.12, output="mug.safetensors")
    except ObjectFolderError as error:
        print(error.where, error.finding, error.remedy)
    else:
        print(built == mug, built.fidelity)
