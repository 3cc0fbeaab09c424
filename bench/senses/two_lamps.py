"""Computed sight under two coloured lamps at once, against Cycles, and under 64, against the sum of each.

    python -m bench two_lamps --folder FOLDER --objects data/starter.csv [--only ID ...]

Truth and rows are kept in FOLDER and not made again.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import conclude, cpu_seconds, rows_of, spread
from bench.senses.catalogue import Scans, scan_arguments
from bench.senses.subject import Subject, errors
from bench.senses.vision_objects import COUNTS
from objectfolder.fidelity.sight import FOREGROUND_ALPHA, measure_within
from objectfolder.making.views.cycles_process import render_in_children
from objectfolder.making.views.passes import with_cast_coverage
from objectfolder.making.views.render_request import Shots, unit_scene
from objectfolder.vision.cameras import CAMERA_RADIUS, FIELD_OF_VIEW_DEG, look_at, uniform_on_sphere
from objectfolder.vision.compositing import on_white
from objectfolder.vision.visionnet.visionnet import VisionNet

RESOLUTION, VIEWS, SAMPLES, MOST_SAMPLES = 128, 4, 64, 1024
COLOURS = np.array([[1.0, 0.45, 0.2], [0.25, 0.5, 1.0]])
LAMPS, REPEATS = 64, 8
COMPARED = (
    "8-bit sRGB on white of computed sight under two coloured lamps against Cycles: PSNR of the foreground "
    "(pixels covered by half). Light adds up: truth is the sum of one render of each lamp, times its colour. "
    "64 lamps in one query: CPU seconds over one lamp's, foreground against the sum of 64 queries"
)


def measured(scans: Scans, folder: Path, name: str) -> dict[str, Any]:
    """Return the row of an object."""
    subject, random = Subject(scans, name, folder, COUNTS["known"], "known"), np.random.default_rng(0)
    cameras = look_at(uniform_on_sphere(VIEWS, CAMERA_RADIUS, random))
    lamps = uniform_on_sphere(2 * VIEWS, 1.0, random).reshape(2, VIEWS, 3)
    path = folder / "two_lamps" / f"{name}.npy"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        scene = unit_scene(subject.mesh, subject.appearance, subject.frame)
        shots = Shots(
            np.tile(cameras, (2, 1, 1)), lamps.reshape(-1, 3), np.arange(2 * VIEWS, dtype=np.int32), SAMPLES,
            RESOLUTION, RESOLUTION, FIELD_OF_VIEW_DEG, most_samples=MOST_SAMPLES,
        )  # fmt: skip
        images = render_in_children(scene, shots)
        np.save(
            path, with_cast_coverage(scene, images, shots.camera_to_world, shots.seeds, FIELD_OF_VIEW_DEG)
        )
    lamp_images = np.load(path).reshape(2, VIEWS, RESOLUTION, RESOLUTION, 4)
    colour = np.einsum("lnyxc,lc->nyxc", lamp_images[..., :3], COLOURS)
    truth = np.concatenate([colour, lamp_images[..., 3:].mean(axis=0)], axis=-1).astype(np.float32)
    net, _ = subject.sight
    colours = np.broadcast_to(COLOURS, (VIEWS, 2, 3))
    lights = np.swapaxes(lamps, 0, 1)
    net.render(cameras[:1], lights[:1], 8, 20.0, light_colour=colours[:1])  # the first query compiles
    start = cpu_seconds()
    image = net.render(cameras, lights, RESOLUTION, FIELD_OF_VIEW_DEG, light_colour=colours)
    seconds = (cpu_seconds() - start) / VIEWS
    views = measure_within(on_white(truth), truth[..., 3] >= FOREGROUND_ALPHA, on_white(image))
    return {
        "foreground_db": float(np.mean(views)),
        "worst_view_db": min(views),
        "image_cpu_s": seconds,
        **many_lamps(net, cameras[0]),
    }


def many_lamps(net: VisionNet, camera: np.ndarray) -> dict[str, float]:
    """Return how many times one lamp's CPU seconds `LAMPS` take, and how near they are to their sum."""
    lamps = uniform_on_sphere(LAMPS, 1.0, np.random.default_rng(0))[None]
    colours = np.full((1, LAMPS, 3), 4 / LAMPS)

    def image(part: slice) -> np.ndarray:
        shown: np.ndarray = net.render(
            camera[None], lamps[:, part], RESOLUTION, FIELD_OF_VIEW_DEG, light_colour=colours[:, part]
        )
        return shown

    together = image(slice(None))  # the first query compiles
    start = cpu_seconds()
    for _ in range(REPEATS):
        image(slice(None))
    many, start = (cpu_seconds() - start) / REPEATS, cpu_seconds()
    alone = [image(slice(index, index + 1)) for index in range(LAMPS)]
    single = (cpu_seconds() - start) / LAMPS
    summed = np.concatenate([np.sum([lit[..., :3] for lit in alone], axis=0), together[..., 3:]], axis=-1)
    foreground = errors(summed, on_white(together))["psnr_foreground_db"]
    return {"many_lamps_cpu_ratio": many / single, "many_lamps_foreground_db": foreground}


def main() -> None:
    """Measure the objects asked for."""
    options = scan_arguments(__doc__, "truth, files and rows", only=()).parse_args()
    scans = Scans(options.objects)
    measure = partial(measured, scans, options.folder)
    rows = rows_of(options.only or scans.ids, measure, options.folder / "rows" / "two_lamps")
    keys = ("foreground_db", "many_lamps_foreground_db")
    summary = {key: spread(rows.values(), key) for key in keys}
    summary["many_lamps_cpu_ratio"] = spread(rows.values(), "many_lamps_cpu_ratio", max)
    settings = {
        "views": VIEWS, "samples": f"{SAMPLES} to {MOST_SAMPLES}", "colours": COLOURS, "many_lamps": LAMPS,
    }  # fmt: skip
    conclude("two_lamps", {"summary": summary, "objects": rows}, settings, COMPARED)
