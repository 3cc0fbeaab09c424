"""How often a second two fingers that squeeze a mug are felt, on one core.

    OMP_NUM_THREADS=1 python -m bench live_touch

In MuJoCo two fingers close on the hull of the package's mug, lift it, shake it and ease off until it slips.
Images, forces and markers of both are asked for after every few steps; what takes the seconds is told apart.
The environment `Squeeze` is stepped.
"""

from typing import Any

import numpy as np

import objectfolder
from bench.record import Stopwatch, arguments, conclude
from objectfolder.live import Felt, Finger, LiveTouch, MujocoSimulation
from objectfolder.live.gripper import FINGERS, gripper
from objectfolder.touch.elastic.markers import Markers

STEP_S, BETWEEN, RUNS, STEPS = 0.002, 8, 3, 40
SQUEEZE_N, FRICTION = 6.0, 0.8
# Of the scene, seconds: closed, lifted, shaken; then they ease off.
CLOSED_S, LIFTED_S, SHAKEN_S, END_S = 0.5, 1.0, 2.0, 2.4
COMPARED = "pairs of touches over CPU seconds of one core, alone and with markers; steps of an environment"


def command(data: Any) -> None:
    """Set the motors by the time."""
    now = data.time
    force = SQUEEZE_N * min(1.0, now / CLOSED_S)
    speed = 0.06 if CLOSED_S < now <= LIFTED_S else 0.0
    if LIFTED_S < now <= SHAKEN_S:
        speed = 0.003 * 2 * np.pi * 3 * np.cos(2 * np.pi * 3 * (now - LIFTED_S))
    if now > SHAKEN_S:
        force *= 1 - (now - SHAKEN_S) / (END_S - SHAKEN_S)
    data.ctrl[:] = [force, force, speed, speed]


def squeeze() -> dict[str, Any]:
    """What it costs, and what is felt meanwhile."""
    import mujoco

    file, watch, rows = objectfolder.example("mug"), Stopwatch(), []
    model = gripper(file, FRICTION, STEP_S)
    data = mujoco.MjData(model)
    simulation = MujocoSimulation(model, data)
    touch = LiveTouch(simulation, {"object": file}, {name: Finger(friction=FRICTION) for name in FINGERS})
    for felt in touch.feel().values():  # the first compiles kernels
        felt.markers()
    while data.time < END_S:
        with watch.step("physics"):
            for _ in range(BETWEEN):
                command(data)
                simulation.step()
        with watch.step("images and forces"):
            pair = touch.feel()
        with watch.step("markers"):
            moved = [felt.markers() for felt in pair.values()]
        rows.append(_row(data.time, pair[FINGERS[0]], moved[0]))
    pairs = len(rows)
    images_s = watch.cpu_s["images and forces"]
    return {
        "pairs": pairs,
        "pairs_per_cpu_s": pairs / images_s,
        "pairs_with_markers_per_cpu_s": pairs / (images_s + watch.cpu_s["markers"]),
        "real_time_factor_at_62_hz": END_S / sum(watch.cpu_s.values()),
        "cpu_s": dict(watch.cpu_s),
        "felt": rows[::2],
    }


def environment() -> dict[str, Any]:
    """What a step of the environment costs that squeezes and lifts: physics, image, sound, both touches."""
    from objectfolder.live.environments import Squeeze

    world, watch = Squeeze(), Stopwatch()
    for _ in range(2):  # the first compiles kernels
        world.reset(seed=0)
        watch.cpu_s.clear()
        with watch.step("steps"):
            for step in range(STEPS):
                world.step(np.array([0.2, 0.0 if step < STEPS / 2 else 0.5], np.float32))
    simulated_s = STEPS * world.observation_space["audio"].shape[0] / 44100.0
    return {
        "real_time_factor": simulated_s / watch.cpu_s["steps"],
        "ms_a_step": 1e3 * watch.cpu_s["steps"] / STEPS,
    }


def _row(time_s: float, felt: Felt, moved: Markers) -> dict[str, Any]:
    """What one of the fingers feels; the other mirrors it."""
    return {
        "time_s": round(time_s, 3),
        "penetration_mm": 1e3 * felt.penetration_m,
        "normal_n": felt.normal_n,
        "tangential_n": felt.tangential_n,
        "sliding": felt.sliding,
        "largest_shift_of_a_marker_pixels": float(np.hypot(*(moved.pixels - moved.rest_pixels).T).max()),
    }


def main() -> None:
    arguments(__doc__).parse_args()
    runs = [squeeze() for _ in range(RUNS)]
    figures = {
        "squeeze": max(runs, key=lambda run: float(run["pairs_per_cpu_s"])),
        "environment": max(
            (environment() for _ in range(RUNS)), key=lambda run: float(run["real_time_factor"])
        ),
    }
    settings = {"step_s": STEP_S, "steps_between": BETWEEN, "squeeze_n": SQUEEZE_N, "friction": FRICTION}
    settings["runs"] = RUNS
    conclude("live_touch", figures, settings, COMPARED)
