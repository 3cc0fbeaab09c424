"""Sight of those of a hundred scans that had the lowest foreground, by today's code, and of controls.

    python -m bench.factory.lowest_scans --folder FOLDER [--objects CATALOGUE.csv] [--only ID ...]

A whole run of `bench.factory.hundred` takes hours. This makes views and VisionNet alone, of the `LOWEST`
scans with the lowest foreground in ``bench/results/hundred_per_object.csv`` and of `CONTROLS` drawn from
its middle half, with that run's parameters and seeds. Rows are kept in FOLDER and not measured again; the
result is of the rows at hand.
"""

import csv
from functools import partial
from typing import Any

import numpy as np

from bench.factory.hundred import TABLE
from bench.record import REPOSITORY, Stopwatch, conclude, kept
from bench.senses.catalogue import Scans, scan_arguments
from objectfolder.fidelity.sight import FOREGROUND_ALPHA, measure_sight
from objectfolder.products.provenance import seed_from
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG
from objectfolder.vision.compositing import on_white
from objectfolder.vision.truth.views import simulate_views
from objectfolder.vision.visionnet.fitting import fit_visionnet
from objectfolder.vision.visionnet.map_sampling import sample_maps, stored_mesh
from objectfolder.vision.visionnet.visionnet import VisionNet
from pipeline.dataset.parameters import read_parameters

LOWEST, CONTROLS, CONTROL_SEED = 14, 4, 0
COMPARED = (
    "PSNR of 8-bit sRGB on white over the foreground (pixels covered by half), held-out cameras and lights, "
    "of the scans that were lowest in the table of a hundred and of controls; all others count as there"
)


def before() -> dict[str, float]:
    """Return the foreground of each scan in the table of a hundred, dB, lowest first."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        rows = {row["id"]: float(row["vision.psnr_foreground_db"]) for row in csv.DictReader(file)}
    return dict(sorted(rows.items(), key=lambda row: row[1]))


def measured(scans: Scans, name: str, parameters: Any) -> dict[str, Any]:
    """Return the row of a scan: its errors, the noise of its truth, and CPU seconds."""
    mesh, material, watch = scans.mesh(name), scans.material(name), Stopwatch()
    appearance = Appearance(roughness=material.roughness, metallic=material.metallic)
    seeds = {stage: seed_from(parameters.seed, stage, name) for stage in ("views", "encode")}
    with watch.step("views"):
        views = simulate_views(mesh, appearance, **parameters.values_at("vision"), seed=seeds["views"])
    surface = decode_surface(encode_surface(mesh.surface))
    frame = UnitFrame.from_dict(views.attributes["frame"])
    maps = sample_maps(stored_mesh(mesh, surface), frame, appearance)
    with watch.step("fit"):
        fit = parameters.values_at("encode")["visionnet"]
        fitted = fit_visionnet(surface, frame, views, maps=maps, seed=seeds["encode"], **fit)
    net = VisionNet.from_tensors(fitted.tensors(), fitted.metadata(), surface, frame)
    held_out = views["held_out"]
    rgba = views["rgba"][held_out].astype(np.float32)
    cameras, lights = views["camera_to_world"][held_out], views["light_position"][held_out]
    answer = on_white(net.render(cameras, lights, rgba.shape[1:3], FIELD_OF_VIEW_DEG))
    found = measure_sight(on_white(rgba), rgba[..., 3] >= FOREGROUND_ALPHA, answer)
    found["views_foreground_db"] = [row["psnr_foreground_db"] for row in found.pop("per_view")]
    noise = {key: views.attributes[key] for key in ("noise_floor_db", "noise_floor_foreground_db")}
    return {
        **found,
        **noise,
        "bytes": sum(tensor.nbytes for tensor in fitted.tensors().values()),
        "cpu_s": watch.cpu_s,
    }


def main() -> None:
    """Measure the lowest scans and the controls."""
    old, parameters = before(), read_parameters(REPOSITORY / "params.yaml")
    names = list(old)
    middle = names[len(names) // 4 : len(names) * 3 // 4]
    controls = sorted(np.random.default_rng(CONTROL_SEED).choice(middle, CONTROLS, replace=False).tolist())
    chosen = (*names[:LOWEST], *controls)
    parser = scan_arguments(__doc__, "rows")
    parser.add_argument("--only", nargs="*", default=chosen, choices=chosen, metavar="ID")
    given = parser.parse_args()
    scans = Scans(given.objects)
    for name in given.only:
        kept(given.folder / f"{name}.json", partial(measured, scans, name, parameters))
    found = {
        name: {"before_db": old[name], **kept(path, dict)}
        for name in chosen
        if (path := given.folder / f"{name}.json").exists()
    }
    now = old | {name: row["psnr_foreground_db"] for name, row in found.items()}
    worst = sorted(now, key=now.__getitem__)
    summary = {
        "foreground_db": {
            "mean": float(np.mean(list(now.values()))),
            "worst_tenth_begins_at": now[worst[len(worst) // 10]],
            "worst": now[worst[0]],
            "worst_object": worst[0],
        },
        "of": "the scans below measured again, the others as before",
        "controls_change_db": {
            name: row["psnr_foreground_db"] - old[name] for name, row in found.items() if name in controls
        },
        "missing": [name for name in chosen if name not in found],
    }
    settings = {"size": parameters.size, "seed": parameters.seed, "control_seed": CONTROL_SEED}
    conclude("lowest_scans", {"summary": summary, "scans": found}, settings, COMPARED)


if __name__ == "__main__":
    main()
