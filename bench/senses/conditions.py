"""Object Files away from the views of their data set: finer images, other lamps, environments.

    python -m bench conditions --folder FOLDER [--data FOLDER] [--only ID ...]

The files of a finished data set are measured as its own report does where `vision.condition_views` asks.
Truths and rows are kept in FOLDER and not made again.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import objectfolder
from bench.record import REPOSITORY, arguments, conclude, cpu_seconds, measure_once, rows_of, spread
from objectfolder.fidelity.conditions import measure_conditions
from objectfolder.making.views.conditions import render_conditions
from objectfolder.making.views.render_request import unit_scene
from objectfolder.products.store import Product, read_attributes, read_product, write_product
from objectfolder.surface.textured_mesh import textured_mesh_of
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.conditions import CONDITIONS

VIEWS, SAMPLES = 2, 256
COMPARED = (
    "8-bit sRGB on white of Object Files against Cycles in parts of 64 x 64 pixels of views with cameras, "
    "lamps and points looked at of their own: PSNR of the foreground (pixels covered by half), mean of "
    "views; the truth's noise floor, and its mean colour in the true silhouette; CPU seconds of both"
)


def measured(data: Path, name: str, folder: Path) -> dict[str, Any]:
    """Return the row of an object of a finished data set."""
    file = objectfolder.load(data / "object_files" / f"{name}.safetensors")
    path = folder / f"{name}.views.zarr.zip"
    record = folder / f"{name}.truth.json"
    truth_cpu_s = measure_once(record, partial(_render, data, name, path))["cpu_s"]
    views = read_product(path)
    measure_conditions(file, views)  # the first query compiles
    start = cpu_seconds()
    figures = measure_conditions(file, views)
    return {**figures, "truth_cpu_s": truth_cpu_s, "measures_cpu_s": cpu_seconds() - start}


def _render(data: Path, name: str, path: Path) -> dict[str, float]:
    attributes = read_attributes(data / "views" / f"{name}.zarr.zip")
    mesh = textured_mesh_of(read_product(data / "objects" / f"{name}.zarr.zip"))
    file = objectfolder.load(data / "object_files" / f"{name}.safetensors")
    how = {key: attributes[key] for key in ("camera_radius", "field_of_view_deg", "light_power_w")}
    start = cpu_seconds()
    arrays, conditions = render_conditions(
        unit_scene(mesh, Appearance(**attributes["appearance"]), file.frame),
        VIEWS, SAMPLES, np.random.SeedSequence(0), **how, threads=1,
    )  # fmt: skip
    seconds = cpu_seconds() - start
    write_product(path, Product(arrays, conditions | how))
    return {"cpu_s": seconds}


def main() -> None:
    """Measure everything that is not in the folder yet."""
    parser = arguments(__doc__, keeps="truths and rows", only=())
    parser.add_argument("--data", type=Path, default=REPOSITORY / "data", help="of a finished data set")
    options = parser.parse_args()
    names = options.only or sorted(
        path.stem for path in (options.data / "object_files").glob("*.safetensors")
    )
    rows = rows_of(names, lambda name: measured(options.data, name, options.folder), options.folder / "rows")
    keys = (f"{figure}_{name}_db" for figure in ("psnr", "noise_floor") for name in CONDITIONS)
    summary = {key: spread(rows.values(), key) for key in keys}
    summary |= {key: spread(rows.values(), key, max) for key in ("truth_cpu_s", "measures_cpu_s")}
    settings = {"views": VIEWS, "samples": SAMPLES, "conditions": {k: vars(v) for k, v in CONDITIONS.items()}}
    conclude("conditions", {"summary": summary, "objects": rows}, settings, COMPARED)
