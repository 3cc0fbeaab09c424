"""Modes of every scan of a data set: seconds, memory, stated errors, and what failed and why.

    python -m bench scans ROOT

ROOT is a data set whose stage ``modes`` was made. Seconds and memory are those of the tasks that made it: on
a busy machine CPU seconds are too many.
"""

from pathlib import Path
from typing import Any

import numpy as np

from bench.record import arguments, conclude
from objectfolder.products.store import read_product
from pipeline.dataset.failures import read_failures
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.stages import STAGES
from pipeline.run.costs import known_costs
from pipeline.run.estimates import Estimate, last_costs

STAGE = "modes"
COMPARED = (
    "Stated error of the first 50 audible modes of each object (objectfolder/audio/modes/adaptive.py), and "
    "CPU seconds and largest memory of its task: filling, solving, mode shapes at points, writing"
)


def main() -> None:
    parser = arguments("modes of every scan of a data set")
    parser.add_argument("root", type=Path, help="a data set with its modes")
    root = parser.parse_args().root
    parameters = read_parameters(root / "params.yaml")

    def path_of(name: str) -> Path:
        return STAGES[STAGE].targets(root, name)[0]

    rows = {
        name: row(path_of(name), cost)
        for (name, stage), cost in sorted(last_costs(known_costs(root)).items())
        if stage == STAGE and path_of(name).exists()
    }
    failures = {one.object: f"{one.error} {one.remedy}" for one in read_failures(root) if one.stage == STAGE}
    settings = {"size": parameters.size, "seed": parameters.seed, "threads": 1}
    conclude("scans", figures(rows, failures), settings, COMPARED)


def row(path: Path, cost: Estimate) -> dict[str, Any]:
    """Return one object's figures."""
    modes = read_product(path)
    attributes = modes.attributes
    spent = {"cpu_s": cost.cpu_s, "peak_memory_mb": cost.memory_bytes / 1e6}
    if "absent" in attributes:
        return {"modes": 0, "silent_because": attributes["absent"], **spent}
    errors = modes["error_estimates_cents"]
    errors = errors[np.isfinite(errors)]
    what = attributes["discretisation"]
    return {
        "modes": len(modes["eigenvalues"]),
        "certificate_holds": attributes["count_certificate"]["holds"],
        "error_median_cents": float(np.median(errors)) if len(errors) else None,
        "error_worst_cents": float(errors.max()) if len(errors) else None,
        "unknowns": what["unknowns"],
        "elements": what["elements"],
        "way": what.get("way"),
        "volume_error": what.get("volume_error"),
        "surface_error_rms_m": what.get("surface_error_rms_m"),
        "transfer_distance_max_m": attributes["transfer_distance_max_m"],
        **spent,
    }


def figures(rows: dict[str, dict[str, Any]], failures: dict[str, str]) -> dict[str, Any]:
    audible = [one for one in rows.values() if one["modes"]]
    seconds = [one["cpu_s"] for one in rows.values()]
    memory = {name: one["peak_memory_mb"] for name, one in rows.items()}
    return {
        "objects": rows,
        "answered": len(rows),
        "failed": failures,
        "refused": {name: one["silent_because"] for name, one in rows.items() if "silent_because" in one},
        "with_an_audible_mode": len(audible),
        "error_cents": {
            "median_over_objects_of_their_median": median(audible, "error_median_cents"),
            "median_over_objects_of_their_worst": median(audible, "error_worst_cents"),
        },
        "cpu_s": {"median": float(np.median(seconds)), "largest": max(seconds), "sum": sum(seconds)},
        "peak_memory_mb": {
            "median": float(np.median(list(memory.values()))),
            "largest": max(memory.values()),
            "above_3_gb": {name: one for name, one in memory.items() if one > 3000},
        },
    }


def median(rows: list[dict[str, Any]], key: str) -> float:
    return float(np.median([row[key] for row in rows]))
