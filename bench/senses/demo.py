"""What `objectfolder demo` costs: from a fresh process to its first image, while objects move, and at rest.

    OMP_NUM_THREADS=1 python -m bench demo

CPU seconds of one core, for other processes may share it. Kernels are in numba's cache. The first image is
the draft that the page asks for; the browser and its page run on another core meanwhile, and are not counted.
Then one object or all four rise, sink and turn by 6 degrees from frame to frame. At rest one has moved.
Drafts are held against images of one ray a pixel, on the pixels where both show the same object.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import psutil

from bench.record import arguments, conclude

FRAMES, RUNS, TURN_RAD = 10, 2, 0.1
SIDES, FINEST = (128, 192, 256), 512
FIRST = "--first-image"
COMPARED = (
    "CPU seconds of one core: of a fresh process until each part of its first image is done; milliseconds of "
    "an image while one object or four move, as drafts and by one ray a pixel; seconds of an image of "
    "512x512 after one object has moved; mean difference of drafts to images of one ray a pixel, levels"
)


def first_image() -> dict[str, float]:
    """CPU seconds of this process and of the one that draws, since it began, after each part."""
    after = {"interpreter": process_time()}
    from pipeline.publish.demo import write_demo
    from pipeline.publish.scenes.opened_scene import OpenedScene, camera_over
    from pipeline.publish.viewer.live import one_thread_each
    from pipeline.publish.viewer.played_world import PlayedWorld

    one_thread_each()
    after["imports"] = process_time()
    with tempfile.TemporaryDirectory() as folder:
        opened = OpenedScene.of(write_demo(Path(folder)))
        after["scene"] = process_time()
        world = PlayedWorld(opened)
        after["world"] = process_time()
    world.seen(
        {"camera_to_world": camera_over(world._points).tolist(), "resolution": SIDES[0], "draft": True}
    )
    drawing_s = sum(sum(child.cpu_times()[:2]) for child in psutil.Process().children())
    after["first image"] = process_time() + drawing_s
    return after


class Moving:
    """The demo's world, whose objects are moved by hand."""

    def __init__(self) -> None:
        from pipeline.publish.demo import write_demo
        from pipeline.publish.scenes.opened_scene import OpenedScene, camera_over
        from pipeline.publish.viewer.played_world import PlayedWorld

        with tempfile.TemporaryDirectory() as folder:
            self.world = PlayedWorld(OpenedScene.of(write_demo(Path(folder))))
        self.names, self.camera = list(self.world._files), camera_over(self.world._points)
        self.sight = self.world.sight(self.world._poses)
        self.stood, self.frame = dict(self.world._poses.by_body), 0

    def move(self, count: int) -> None:
        """Move and turn the last objects."""
        from scipy.spatial.transform import Rotation

        self.frame += 1
        poses = dict(self.stood)
        for name in self.names[-count:]:
            pose = self.stood[name].copy()
            pose[2, 3] += 0.01 + 0.01 * np.sin(0.3 * self.frame)
            turn = Rotation.from_rotvec([0.0, 0.0, TURN_RAD * self.frame]).as_matrix()
            pose[:3, :3] = turn @ pose[:3, :3]
            poses[name] = pose
        self.world._poses.tell(poses)

    def cpu_s(self, count: int, side: int, **how: Any) -> float:
        """Median CPU seconds of an image after some objects have moved."""
        spent = []
        for _ in range(FRAMES if side < FINEST else RUNS):
            self.move(count)
            begun_s = process_time()
            self.sight.image(self.camera, side, **how)
            spent.append(process_time() - begun_s)
        return statistics.median(spent)

    def apart(self) -> dict[str, float]:
        """How far drafts are from images of one ray a pixel."""
        draft, image = (
            self.sight.image(self.camera, SIDES[-1], **how) for how in ({"draft": True}, {"sub_rays": 1})
        )
        figures = {}
        for number, name in enumerate(self.names):
            both = (draft.body == number) & (image.body == number)
            apart = draft.rgb[both].astype(float) - image.rgb[both]
            figures[name] = float(abs(apart).mean())
        return figures


def figures() -> dict[str, Any]:
    command = [sys.executable, "-m", "bench", "demo", FIRST]
    starts = [
        json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
        for _ in range(RUNS + 1)
    ][1:]  # the first fills caches
    moving = Moving()
    moving.sight.image(moving.camera, FINEST, sub_rays=16)
    ways = {"draft": {"draft": True}, "one ray": {"sub_rays": 1}}
    return {
        "first_image_cpu_s": min(starts, key=lambda start: start["first image"]),
        "frame_cpu_ms": [
            {"way": way, "side": side, "moving": count, "ms": 1e3 * moving.cpu_s(count, side, **how)}
            for way, how in ways.items()
            for side in (SIDES if way == "draft" else SIDES[:1])
            for count in (1, len(moving.names))
        ],
        "rest_cpu_s": {
            "draft": moving.cpu_s(1, FINEST, draft=True),
            "16 sub-rays": moving.cpu_s(1, FINEST, sub_rays=16),
        },
        "draft_apart_levels": moving.apart(),
        "load_average": os.getloadavg()[0],
    }


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument(FIRST, action="store_true", help="draw the first image alone, and say when")
    if vars(parser.parse_args())["first_image"]:
        print(json.dumps(first_image()))
        return
    settings = {
        "frames": FRAMES,
        "runs": RUNS,
        "turn_rad": TURN_RAD,
    }
    conclude("demo", figures(), settings, COMPARED)
