"""How much faster than real time a scene is played: physics, sound, touch and sight together, on one core.

    OMP_NUM_THREADS=1 python -m bench live_play

Three objects of the package stand on a table in MuJoCo as their hulls. Two fingers grip the first, lift and
lower it without end; the others are dropped from 10 cm every two seconds. Beside the sound, both tactile
images are asked for 60 times a second, and a view of 128x128 with table and shadows 30 times. What takes the
seconds is told apart. A listener with a buffer would run dry where the world falls behind by more than that:
the largest lag is what the seconds of one core say. The first two seconds, in which files unpack what they
need, are not counted. Then single queries are timed, of the kinds that ObjectFolder 2.0 tells the time of.
"""

from time import process_time
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

import objectfolder
from bench.record import Stopwatch, arguments, conclude
from bench.senses.simulated import BLOCK, RATE_HZ, STEP_S, Watched, add_body, table
from objectfolder.live import Finger, LiveSight, LiveSound, LiveTouch
from objectfolder.object_file import ObjectFile
from objectfolder.vision.cameras import look_at
from pipeline.publish.scenes.handling import FELT_BY, FRICTION, Handling

NAMES = ("mug", "bell", "mug")
WARM_S, SECONDS, RUNS = 2.0, 60.0, 1
TOUCHES_HZ, VIEWS_HZ, PIXELS = 60, 30, 128
SQUEEZE_N, LIFTING_M_S, EVERY_S, DROP_M = 6.0, 0.05, 2.0, 0.1
QUERIES = 30
CAMERA = look_at(np.array([[0.25, -0.75, 0.5]]), np.array([0.25, 0.0, 0.05]))[0]
COMPARED = (
    "seconds of the scene over CPU seconds of one core, all parts together and apart; how far the world "
    "falls behind at most, seconds, where nothing else runs on that core; medians of single queries of "
    "open files: an image of 256x256, three seconds of sound, a tactile image"
)


class World(Watched, Handling):
    """A scene that hands move."""


def scene() -> tuple[Any, dict[str, ObjectFile]]:
    """A table with objects 25 cm apart, as a specification for MuJoCo, and their files."""
    import mujoco

    spec, files = table(), {}
    for place, name in enumerate(NAMES):
        body_name = f"{place}_{name}"
        file = files[body_name] = objectfolder.example(name)
        vertices = file.surface.vertices
        hull = vertices[ConvexHull(vertices).vertices]
        spec.add_mesh(name=body_name, uservert=hull.ravel().tolist())
        body = add_body(spec, body_name, file, pos=[0.25 * place, 0, -vertices[:, 2].min()])
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=body_name)
    return spec, files


def played(seconds: float) -> dict[str, Any]:
    """What some seconds of it cost."""
    spec, files = scene()
    world, watch = World(spec, files), Stopwatch()
    sound = LiveSound(world, files, listener_m=tuple(CAMERA[:3, 3]))
    sight = LiveSight(world, files, table_m=(1.0, 0.0))
    touch = LiveTouch(world, files, {name: Finger(friction=FRICTION) for name in FELT_BY})
    world.reach_round("0_mug", np.array([0.0, 1.0, 0.0]))
    world.watch = watch
    due = {"touches": 0, "views": 0, "drops": 0}
    lag_s = largest_s = now_s = 0.0
    while now_s < WARM_S + seconds:
        if now_s - BLOCK / RATE_HZ < WARM_S <= now_s:
            watch.cpu_s.clear()
            lag_s = largest_s = 0.0
        begun_s = process_time()
        for name in files if now_s >= EVERY_S * due["drops"] else ():
            if name != "0_mug":
                world.lift(name, DROP_M)
        world.grip(SQUEEZE_N, LIFTING_M_S if due["drops"] % 2 else -LIFTING_M_S)
        due["drops"] += now_s >= EVERY_S * due["drops"]
        with watch.step("physics, contacts, sound"):
            sound.block()
        if now_s >= due["touches"] / TOUCHES_HZ:
            due["touches"] += 1
            with watch.step("touches"):
                touch.feel()
        if now_s >= due["views"] / VIEWS_HZ:
            due["views"] += 1
            with watch.step("views"):
                sight.image(CAMERA, PIXELS, sub_rays=1)
        now_s += BLOCK / RATE_HZ
        lag_s = max(0.0, lag_s + process_time() - begun_s - BLOCK / RATE_HZ)
        largest_s = max(largest_s, lag_s)
    spent = watch.cpu_s
    now_s -= WARM_S
    sounding = spent.pop("physics, contacts, sound")
    spent["sound"] = sounding - spent["physics"] - spent["contacts"]
    return {
        "seconds": now_s,
        "collisions": len(sound.impacts),
        "touches": due["touches"],
        "views": due["views"],
        "lifted_m": float(world.pose("0_mug")[2, 3]),
        "real_time_factor": now_s / sum(spent.values()),
        "cpu_s_per_second": {name: cpu_s / now_s for name, cpu_s in spent.items()},
        "largest_lag_s": largest_s,
    }


def queries() -> dict[str, float]:
    """Milliseconds of a query of the kinds that ObjectFolder 2.0 tells, the median over the objects' own."""
    spent: dict[str, list[float]] = {"image_256_ms": [], "sound_3_s_ms": [], "touch_ms": []}
    for name in sorted(set(NAMES)):
        file = objectfolder.example(name)
        cameras, lights = file.sample_views(QUERIES, seed=0)
        points, normals = file.sample_contacts(QUERIES, seed=0)
        for camera, light, point, normal in zip(cameras, lights, points, normals, strict=True):
            calls = (
                lambda camera=camera, light=light, file=file: file.render(camera, light, 256),
                lambda point=point, normal=normal, file=file: file.strike(point, -normal, duration_s=3.0),
                lambda point=point, file=file: file.press(point, 0.001),
            )
            for name_of, ask in zip(spent, calls, strict=True):
                begun_s = process_time()
                ask()
                spent[name_of].append(1e3 * (process_time() - begun_s))
    return {name: float(np.median(times)) for name, times in spent.items()}


def main() -> None:
    arguments(__doc__).parse_args()
    played(1.0)  # the first compiles kernels
    runs = [played(SECONDS) for _ in range(RUNS)]
    best = max(runs, key=lambda figures: float(figures["real_time_factor"]))
    settings = {
        "objects": NAMES, "step_s": STEP_S, "block": BLOCK, "rate_hz": RATE_HZ, "runs": RUNS,
        "touches_hz": TOUCHES_HZ, "views_hz": VIEWS_HZ, "pixels": PIXELS,
    }  # fmt: skip
    conclude("live_play", {"played": best, "queries": queries()}, settings, COMPARED)
