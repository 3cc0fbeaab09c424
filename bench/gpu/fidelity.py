"""Views of a data set's files against its truth, by what a view costs."""

import os
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.gpu.run import EFFORTS, Run

# The data set: its views and Object Files are asked.
DATA = Path(os.environ.get("BENCH_DATA", Path(__file__).parents[2] / "data"))
SINGLE_SUB_RAYS = (16, 64)


def sight_truth(run: Run) -> dict[str, Any]:
    """Measure all objects of the data set."""
    import objectfolder
    from objectfolder.products.store import read_product

    paths = sorted((DATA / "object_files").glob("*.safetensors"))
    if not paths:
        raise FileNotFoundError(
            f"{DATA}: no Object Files. Run `make dataset`, or name a folder by BENCH_DATA."
        )
    return {
        path.stem: of_object(run, objectfolder.load(path), read_product(DATA / f"views/{path.stem}.zarr.zip"))
        for path in paths
    }


def of_object(run: Run, file: Any, views: Any) -> dict[str, dict[str, float]]:
    """Return PSNR of the foreground of held-out views, dB, and seconds of a view in batches."""
    from objectfolder.batch import Batch
    from objectfolder.fidelity.sight import held_out_answer, held_out_truth, measure_sight

    truth, foreground = held_out_truth(views)
    held_out = views["held_out"]
    cameras = file.frame.camera_to_object(views["camera_to_world"][held_out])
    lights = file.frame.to_object(views["light_position"][held_out])
    angle = float(views.attributes["field_of_view_deg"])
    render = partial(Batch([file], run.device).sight.render, 0, cameras, lights, truth.shape[1:3], angle)

    def error(answer: np.ndarray) -> dict[str, float]:
        measured = measure_sight(truth, foreground, answer)
        worst = min(row["psnr_foreground_db"] for row in measured["per_view"] if row["psnr_foreground_db"])
        return {"mean_db": measured["psnr_foreground_db"], "worst_db": worst}

    rows = {f"single_{rays}": error(held_out_answer(file, views, rays)) for rays in SINGLE_SUB_RAYS}
    for name, effort in EFFORTS.items():
        work = partial(render, **effort)
        row = error(work().cpu().numpy())
        row["view_s"] = run.seconds(work, 3) / len(truth)
        rows[f"batch_{name}"] = row
    return rows
