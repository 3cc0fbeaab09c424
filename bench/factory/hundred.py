"""A large data set made end to end: fidelity of its objects, failures with reasons, what all of it cost.

    python -m bench hundred ROOT

ROOT is a data set that was made and reported. Writes ``bench/results/hundred.json`` and ``.png``, and the
report's table of objects beside them, ``hundred_per_object.csv``. Seconds are those of the runs that made it:
on a busy machine CPU seconds are too many.
"""

import csv
import shutil
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.record import RESULTS, arguments, conclude
from pipeline.dataset.failures import read_failures
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.records import read_table
from pipeline.dataset.selection import read_selection
from pipeline.dataset.stages import STAGES
from pipeline.run.costs import known_costs
from pipeline.run.estimates import last_costs

TABLE = RESULTS / "hundred_per_object.csv"
# Column of the table, and whether a larger value is the better one.
MEASURES = {
    "vision.psnr_db": True,
    "vision.psnr_foreground_db": True,
    "vision.ssim": True,
    "audio.gain_error_db": False,
    "audio.stft_distance": False,
    "audio.envelope_distance": False,
    "audio.solver_error_estimate_cents": False,
    "audio.solver_geometry_error_cents": False,
    "touch.psnr_db": True,
    "touch.psnr_contact_db": True,
    "bytes.total": False,
}


def main() -> None:
    parser = arguments("what a data set is worth and what it cost")
    parser.add_argument("root", type=Path, help="a data set with its report")
    root = parser.parse_args().root
    table = root / "reports" / "per_object.csv"
    finished = {stage for _, stage in last_costs(known_costs(root))}
    if unfinished := [name for name in STAGES if name not in finished]:
        parser.error(
            f"{root}: nothing is known of the costs of {', '.join(unfinished)}: make the data set first"
        )
    rows = read_rows(table)
    parameters = read_parameters(root / "params.yaml")
    listed = read_table(root, parameters.objects).selected(read_selection(root))
    stages = {name: stage_cost(root, name) for name in STAGES}
    figures = {
        "objects_listed": len(listed.rows) + len(listed.refused),
        "object_files": len(rows),
        "failures": [
            {
                "stage": failure.stage,
                "object": failure.object,
                "error": failure.error,
                "remedy": failure.remedy,
            }
            for failure in read_failures(root)
        ],
        "fidelity": {name: summary(rows, name, larger) for name, larger in MEASURES.items()},
        "without_audible_mode": sum(not number(row, "audio.modes") for row in rows),
        "stages": stages,
        "cpu_hours": sum(stage["cpu_s"]["sum"] for stage in stages.values()) / 3600,
        "cpu_s_an_object": sum(stage["cpu_s"]["sum"] for stage in stages.values()) / len(rows),
        "bytes": sum(stage["product_bytes"] for stage in stages.values()),
    }
    settings = {"size": parameters.size, "seed": parameters.seed}
    shutil.copyfile(table, TABLE)
    compared = "Object Files against held-out truth; CPU seconds of every task."
    conclude("hundred", figures, settings, compared)


def read_rows(table: Path) -> list[dict[str, str]]:
    """Return a report's table of objects."""
    with table.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def number(row: Mapping[str, str], name: str) -> float | None:
    """Return a cell as a number; None where it is empty or the column is missing."""
    text = row.get(name, "")
    return float(text) if text else None


def summary(rows: Sequence[Mapping[str, str]], name: str, larger_is_better: bool) -> dict[str, Any] | None:
    """Return mean, median, worst tenth and worst object of a measure; None where no object has it."""
    ranking = [(value, row["id"]) for row in rows if (value := number(row, name)) is not None]
    if not ranking:
        return None
    ranking.sort(reverse=not larger_is_better)  # worst first
    values = [value for value, _ in ranking]
    return {
        "objects": len(values),
        "mean": statistics.fmean(values),
        "median": statistics.median(values),
        "worst_tenth_begins_at": values[len(values) // 10],
        "worst": values[0],
        "worst_object": ranking[0][1],
    }


def stage_cost(root: Path, stage: str) -> dict[str, Any]:
    """Return CPU seconds, largest peak of memory and bytes of the products of a stage."""
    costs = {
        name: cost for (name, made_by), cost in last_costs(known_costs(root)).items() if made_by == stage
    }
    cpu = sorted(cost.cpu_s for cost in costs.values())
    paths = [path for name in costs for path in STAGES[stage].targets(root, name)]
    return {
        "tasks": len(cpu),
        "cpu_s": {
            "sum": sum(cpu),
            "median": statistics.median(cpu),
            "p90": cpu[len(cpu) * 9 // 10],
            "most": cpu[-1],
        },
        "peak_memory_bytes": max(cost.memory_bytes for cost in costs.values()),
        "product_bytes": sum(path.stat().st_size for path in paths if path.is_file()),
    }
