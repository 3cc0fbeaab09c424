"""How many fingers that press an object's convex parts show a blank gel.

    OMP_NUM_THREADS=1 python -m bench.senses.live_gels [FILE ...]

Each object stands as its convex parts in MuJoCo, as `objectfolder scene` makes them: the package's mug and
bell, and the Object Files that are named. Two fingers squeeze it with 4 N at the middle of its height, from
24 random directions. Of the fingers that press, some show nothing: where they stand, and taken on to the
surface. The contacts of some of these lie beside the gel.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import objectfolder
from bench.record import arguments, conclude
from objectfolder.live import Felt, Finger, LiveTouch
from objectfolder.live.contacts import finite_pose
from objectfolder.live.touch import _at_gel
from pipeline.publish.scenes.handling import FELT_BY, FRICTION, Handling
from pipeline.publish.scenes.opened_scene import OpenedScene

NAMES, SQUEEZES, SQUEEZE_N, STEPS, PRESSED_N = ("mug", "bell"), 24, 4.0, 300, 0.2
COMPARED = (
    "fingers that press an object's convex parts; those whose gel shows nothing where they stand, and taken "
    "on to the surface; those of the latter that no contact over or within 2 mm of the gel presses; how far "
    "fingers are taken on, millimetres; CPU milliseconds to feel both"
)


def squeezed(file: Path, scene: Path) -> dict[str, Any]:
    """What the fingers of all squeezes of an object show."""
    command = [sys.executable, "-m", "pipeline.cli", "scene", str(file), "-o", str(scene)]
    subprocess.run(command, check=True)
    opened = OpenedScene.of(scene)
    (body,) = opened.files
    fingers = {name: Finger(friction=FRICTION) for name in FELT_BY}
    world = Handling(opened.spec, opened.files)
    touch = LiveTouch(world, opened.files, fingers, onto_surface=True)
    standing, random = LiveTouch(world, opened.files, fingers), np.random.default_rng(0)
    rows, spent_s = [], 0.0
    for _ in range(SQUEEZES):
        angle = random.uniform(0, np.pi)
        world.reset()
        world.reach_round(body, np.array([np.cos(angle), np.sin(angle), 0.0]))
        world.grip(SQUEEZE_N, 0.0)
        for _ in range(STEPS):
            world.step()
        began_s = process_time()
        felt = touch.feel()
        spent_s += process_time() - began_s
        there = standing.feel()
        rows += [_row(world, felt[name], there[name]) for name in fingers if felt[name].normal_n > PRESSED_N]
    return {
        "object": file.stem,
        "pressing": len(rows),
        "blank_where_they_stand": sum(row["blank_there"] for row in rows),
        "blank": sum(row["blank"] for row in rows),
        "blank_beside_the_gel": sum(row["blank"] and not row["at_gel"] for row in rows),
        "advanced_mm": np.percentile([row["advanced_mm"] for row in rows], [50, 90, 100]).tolist(),
        "ms": 1e3 * spent_s / SQUEEZES,
    }


def _row(world: Handling, felt: Felt, there: Felt) -> dict[str, Any]:
    frame = finite_pose(world, felt.name)
    points = [one.point_m for one in world.touching() if felt.name in one.bodies]
    return {
        "blank_there": not there.image.mask.any(),
        "blank": not felt.image.mask.any(),
        "at_gel": any(_at_gel(felt.finger.sensor, frame, point) for point in points),
        "advanced_mm": 1e3 * felt.advanced_m,
    }


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE")
    examples = Path(objectfolder.__file__).parent / "examples"
    files = [examples / f"{name}.safetensors" for name in NAMES] + parser.parse_args().files
    with tempfile.TemporaryDirectory() as folder:
        rows = [squeezed(file, Path(folder) / file.stem / "scene.xml") for file in files]
    pressing = sum(row["pressing"] for row in rows)
    shares = {name: sum(row[name] for row in rows) / pressing for name in rows[0] if name.startswith("blank")}
    settings = {"squeezes": SQUEEZES, "squeeze_n": SQUEEZE_N, "steps": STEPS, "pressed_n": PRESSED_N}
    settings |= {"threads": os.environ.get("OMP_NUM_THREADS", "all")}
    conclude("live_gels", {"objects": rows, "shares": shares}, settings, COMPARED)


if __name__ == "__main__":
    main()
