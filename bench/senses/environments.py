"""Object Files in environments against Cycles in the same: a finished data set and three scans.

Run as ``python -m bench.senses.environments --folder FOLDER [--data FOLDER] [--objects CATALOGUE.csv]``.
FOLDER keeps truth and rows, and is that of `bench.senses.vision_objects`, whose networks the scans take.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import objectfolder
from bench.record import REPOSITORY, conclude, cpu_seconds, kept
from bench.senses.catalogue import Scans, scan_arguments
from bench.senses.vision_objects import NETWORKS, RESOLUTION, Subject, means
from objectfolder.mesh.mesh import textured_mesh_of
from objectfolder.products.store import Array, Product, read_product
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG, uniform_on_sphere
from objectfolder.vision.compositing import on_white
from objectfolder.vision.environment import ENVIRONMENTS, Environment, named_map
from objectfolder.vision.truth.cycles_process import render_in_children
from objectfolder.vision.truth.render_request import Scene, Shots, unit_scene
from objectfolder.vision.visionnet.visionnet import VisionNet

SCANS = ("025_mug", "Threshold_Porcelain_Teapot_White", "painted_wooden_stool")
VIEWS, SAMPLES = 2, 512
LAMPS, REPEATS = 64, 8
COMPARED = (
    "8-bit sRGB on white of VisionNet against Cycles with the same map as its world, cameras held out: PSNR "
    "of the foreground (pixels covered by half) and of all; beside it the same under the views' own lamps; "
    "CPU seconds of an image; and 64 lamps in one query: CPU seconds over one lamp's, foreground against the "
    "sum of 64 queries"
)


def measured(path: Path, net: VisionNet, scene: Scene, views: Product) -> dict[str, Any]:
    """Return the errors of one object in each environment; truth is kept in `path`."""
    cameras = views["camera_to_world"][views["held_out"]]
    lamps = views["light_position"][views["held_out"]]
    lit = net.render(cameras, lamps, RESOLUTION, FIELD_OF_VIEW_DEG)
    found: dict[str, Any] = {
        "lamp": means(views, on_white(lit)),
        "many_lamps": many_lamps(net, cameras[0]),
    }
    for name in ENVIRONMENTS:
        truth = path / f"{name}.npy"
        if not truth.exists():
            path.mkdir(parents=True, exist_ok=True)
            shots = Shots(
                cameras[:VIEWS], lamps[:VIEWS], np.arange(VIEWS), SAMPLES, RESOLUTION, RESOLUTION,
                FIELD_OF_VIEW_DEG, environment=named_map(name),
            )  # fmt: skip
            np.save(truth, render_in_children(scene, shots))
        light = Environment.of(name)
        net.render(cameras[0], light, 8, 20.0)  # the first query compiles
        start = cpu_seconds()
        answer = on_white(net.render(cameras[:VIEWS], light, RESOLUTION, FIELD_OF_VIEW_DEG))
        seconds = (cpu_seconds() - start) / VIEWS
        images = Array(np.load(truth), ("view", "y", "x", "channel"), "1", "scene-linear RGBA")
        held_out = Array(np.ones(VIEWS, dtype=bool), ("view",), "1", "all")
        asked = Product({"rgba": images, "held_out": held_out}, {})
        found[name] = {**means(asked, answer), "image_cpu_s": seconds}
    return found


def of_data_set(data: Path, name: str, path: Path) -> dict[str, Any]:
    """Return the row of an object of a finished data set."""
    file, views = (
        objectfolder.load(data / "object_files" / f"{name}.safetensors"),
        read_product(data / "views" / f"{name}.zarr.zip"),
    )
    mesh = textured_mesh_of(read_product(data / "objects" / f"{name}.zarr.zip"))
    scene = unit_scene(mesh, Appearance(**views.attributes["appearance"]), file.frame)
    return measured(path, file.vision, scene, views)


def of_scan(scans: Scans, name: str, folder: Path) -> dict[str, Any]:
    """Return the row of a scan, by a network that is fitted where the folder has none."""
    at = Subject(scans, name, folder)
    scene = unit_scene(at.mesh, NETWORKS["within_120"].appearance(at.material), at.frame)
    net, views = at.network("within_120")[0], at.views("within_120")[0]
    return measured(folder / "environments" / name, net, scene, views)


def many_lamps(net: VisionNet, camera: np.ndarray) -> dict[str, float]:
    """Return how many times one lamp's CPU seconds `LAMPS` take, and how near they are to their sum."""
    lamps = uniform_on_sphere(LAMPS, 1.0, np.random.default_rng(0))
    colours = np.full((1, LAMPS, 3), 4 / LAMPS)

    def image(part: slice) -> np.ndarray:
        shown: np.ndarray = net.render(
            camera, lamps[None, part], RESOLUTION, FIELD_OF_VIEW_DEG, light_colour=colours[:, part]
        )
        return shown

    image(slice(0, 1))
    together = image(slice(None))  # the first query compiles
    start = cpu_seconds()
    for _ in range(REPEATS):
        image(slice(None))
    many, start = (cpu_seconds() - start) / REPEATS, cpu_seconds()
    alone = [image(slice(index, index + 1)) for index in range(LAMPS)]
    one = (cpu_seconds() - start) / LAMPS
    summed = np.concatenate([np.sum([lit[..., :3] for lit in alone], axis=0), together[..., 3:]], axis=-1)
    images = Array(summed, ("view", "y", "x", "channel"), "1", "scene-linear RGBA")
    asked = Product({"rgba": images, "held_out": Array(np.ones(1, dtype=bool), ("view",), "1", "all")}, {})
    return {"cpu_ratio": many / one, "foreground_db": means(asked, on_white(together))["psnr_foreground_db"]}


def main() -> None:
    """Measure all objects at hand."""
    parser = scan_arguments(__doc__, "truth and networks")
    parser.add_argument("--data", type=Path, default=REPOSITORY / "data", help="of a finished data set")
    given = parser.parse_args()
    scans, at = Scans(given.objects), given.folder / "environments"
    tasks: dict[str, Callable[[], dict[str, Any]]] = {
        path.stem: partial(of_data_set, given.data, path.stem, at / path.stem)
        for path in sorted((given.data / "object_files").glob("*.safetensors"))
    }
    tasks |= {f"scan {name}": partial(of_scan, scans, name, given.folder) for name in SCANS}
    rows = {name: kept(at / f"{name}.json", task) for name, task in tasks.items()}
    cells = [found[name] for found in rows.values() for name in ENVIRONMENTS]
    foreground = [cell["psnr_foreground_db"] for cell in cells]
    summary: dict[str, Any] = {
        "foreground_db": {"mean": float(np.mean(foreground)), "worst": min(foreground)},
        "lamp_foreground_db": float(
            np.mean([found["lamp"]["psnr_foreground_db"] for found in rows.values()])
        ),
        "image_cpu_s": {
            "mean": float(np.mean([cell["image_cpu_s"] for cell in cells])),
            "most": max(cell["image_cpu_s"] for cell in cells),
        },
    }
    for name, of in (("cpu_ratio", max), ("foreground_db", min)):
        many = [found["many_lamps"][name] for found in rows.values()]
        summary[f"many_lamps_{name}"] = {"mean": float(np.mean(many)), "worst": of(many)}
    settings = {"resolution_px": RESOLUTION, "views": VIEWS, "samples": SAMPLES, "lamps": LAMPS}
    conclude("environments", {"summary": summary, "objects": rows}, settings, COMPARED)


if __name__ == "__main__":
    main()
