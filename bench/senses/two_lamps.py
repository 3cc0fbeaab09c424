"""Computed sight under two coloured lamps at once, against Cycles.

    python -m bench two_lamps --folder FOLDER --objects data/starter.csv [--only ID ...]

FOLDER is that of `bench.senses.vision_objects`. Truth and rows are kept there and not made again; the result
is of the rows at hand.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import conclude, cpu_seconds, kept
from bench.senses.catalogue import Scans, scan_arguments
from bench.senses.vision_objects import NETWORKS, RESOLUTION, Subject
from objectfolder.fidelity.sight import FOREGROUND_ALPHA, measure_within
from objectfolder.vision.cameras import CAMERA_RADIUS, FIELD_OF_VIEW_DEG, look_at, uniform_on_sphere
from objectfolder.vision.compositing import on_white
from objectfolder.vision.truth.coverage import with_cast_coverage
from objectfolder.vision.truth.cycles_process import render_in_children
from objectfolder.vision.truth.render_request import LIGHT_POWER_W, Shots, unit_scene
from objectfolder.vision.visionnet.map_sampling import sample_maps, stored_mesh
from objectfolder.vision.visionnet.visionnet import VisionNet

VIEWS, SAMPLES, MOST_SAMPLES = 4, 64, 1024
COLOURS = np.array([[1.0, 0.45, 0.2], [0.25, 0.5, 1.0]])
COMPARED = (
    "8-bit sRGB on white of computed sight under two coloured lamps against Cycles: PSNR of the foreground "
    "(pixels covered by half). Light adds up: truth is the sum of one render of each lamp, times its colour"
)


def measured(scans: Scans, name: str, folder: Path) -> dict[str, Any]:
    """Return the row of an object."""
    at, random = Subject(scans, name, folder), np.random.default_rng(0)
    cameras = look_at(uniform_on_sphere(VIEWS, CAMERA_RADIUS, random))
    lamps = uniform_on_sphere(2 * VIEWS, 1.0, random).reshape(2, VIEWS, 3)
    appearance = NETWORKS["known"].appearance(at.material)
    path = folder / "two_lamps" / f"{name}.npy"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        scene = unit_scene(at.mesh, appearance, at.frame)
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
    maps = sample_maps(stored_mesh(at.mesh, at.surface), at.frame, appearance, "known")
    net = VisionNet(
        at.surface, at.frame, None, {}, radiance_scale=LIGHT_POWER_W / (4 * np.pi**2),
        camera_radius=CAMERA_RADIUS, maps=maps, appearance=appearance,
    )  # fmt: skip
    arguments = np.swapaxes(lamps, 0, 1), RESOLUTION, FIELD_OF_VIEW_DEG
    colours = np.broadcast_to(COLOURS, (VIEWS, 2, 3))
    net.render(cameras[:1], arguments[0][:1], 8, 20.0)  # the first query compiles
    start = cpu_seconds()
    image = net.render(cameras, *arguments, light_colour=colours)
    seconds = (cpu_seconds() - start) / VIEWS
    within = truth[..., 3] >= FOREGROUND_ALPHA
    views = measure_within(on_white(truth), within, on_white(image))
    return {"foreground_db": float(np.mean(views)), "worst_view_db": min(views), "image_cpu_s": seconds}


def main() -> None:
    """Measure the objects asked for."""
    parser = scan_arguments(__doc__, "truth, files and rows")
    parser.add_argument("--only", nargs="+", metavar="ID", help="all of the table by default")
    options = parser.parse_args()
    scans, at = Scans(options.objects), options.folder / "rows" / "two_lamps"
    rows = {
        name: kept(at / f"{name}.json", partial(measured, scans, name, options.folder))
        for name in options.only or scans.ids
    }
    foreground = [row["foreground_db"] for row in rows.values()]
    summary = {"foreground_db": {"mean": float(np.mean(foreground)), "worst": min(foreground)}}
    settings = {"views": VIEWS, "samples": f"{SAMPLES} to {MOST_SAMPLES}", "colours": COLOURS}
    conclude("two_lamps", {"summary": summary, "objects": rows}, settings, COMPARED)
