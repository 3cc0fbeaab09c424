"""Two workers against one on the same real tasks: all stages of the starter set, made small.

Run as ``python -m bench efficiency`` on a machine with nothing else to do. Each round makes the same
data set twice from nothing, with one worker and with two, in turn; nothing is remembered in between.
"""

import csv
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from bench.record import REPOSITORY, arguments, conclude, cpu_seconds

ROUNDS = 3
WORKERS = (1, 2)
# Every task's own work, at a size that a round takes minutes.
SMALL = {
    "vision": {"resolution": 48, "training_views": 30, "held_out_views": 4, "held_out_samples": 64},
    "audio": {"accuracy_cents": 20.0, "max_modes": 48, "training_points": 2000, "held_out_points": 200},
    "touch": {"touches": 40, "held_out_touches": 20},
    "encode": {"visionnet": {"steps": 200}},
}


def prepare(folder: Path) -> None:
    """Write a data set's inputs: tables, parameters and the starter meshes."""
    from pipeline.intake.starter.write import write_starter_set

    (folder / "data").mkdir(parents=True)
    for name in ("starter.csv", "materials.csv"):
        shutil.copy(REPOSITORY / "data" / name, folder / "data" / name)
    write_starter_set(folder / "data" / "starter")
    yaml = YAML()
    parameters = yaml.load((REPOSITORY / "params.yaml").read_text())
    for section, values in SMALL.items():
        for key, value in values.items():
            if isinstance(value, dict):
                parameters["sizes"]["default"][section][key].update(value)
            else:
                parameters["sizes"]["default"][section][key] = value
    with (folder / "params.yaml").open("w") as file:
        yaml.dump(parameters, file)


def run(inputs: Path, workers: int) -> dict[str, Any]:
    """Make the data set from nothing; return seconds of the command and of its tasks."""
    with tempfile.TemporaryDirectory(prefix="efficiency-") as temporary:
        root = Path(temporary) / "set"
        shutil.copytree(inputs, root)
        place = Path(temporary) / "place.yaml"
        place.write_text(f"kwargs: {{threads_per_worker: {workers}}}\n")
        environment = {**os.environ, "OBJECTFOLDER_CLUSTER": str(place), "PYTHONPATH": str(REPOSITORY)}
        for name in ("DASK_SCHEDULER_ADDRESS", "OBJECTFOLDER_STORE"):
            environment.pop(name, None)
        cpu, begin = cpu_seconds(), time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "pipeline.cli", "products"],
            cwd=root, env=environment, check=True, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        wall_s = time.perf_counter() - begin
        command_cpu_s = cpu_seconds() - cpu
        with (root / ".objectfolder" / "costs.csv").open(newline="") as file:
            tasks = [row for row in csv.DictReader(file) if row["wall_seconds"]]
        return {
            "workers": workers,
            "wall_s": wall_s,
            "tasks": len(tasks),
            "task_wall_s": sum(float(row["wall_seconds"]) for row in tasks),
            "task_cpu_s": sum(float(row["cpu_seconds"]) for row in tasks),
            "longest_task_s": max(float(row["wall_seconds"]) for row in tasks),
            "command_cpu_s": command_cpu_s,
        }


def summarise(rounds: list[dict[int, dict[str, Any]]]) -> dict[str, Any]:
    """Return the speed-up of two workers over one, and what of the loss is the machine's."""
    least, most = WORKERS
    speed_up = [done[least]["wall_s"] / done[most]["wall_s"] for done in rounds]
    slower = [done[most]["task_wall_s"] / done[least]["task_wall_s"] for done in rounds]
    busy = [done[most]["task_wall_s"] / (most * done[most]["wall_s"]) for done in rounds]
    return {
        "speed_up_median": statistics.median(speed_up),
        "efficiency_median": statistics.median(speed_up) / most,
        "speed_up_by_round": speed_up,
        "task_seconds_side_by_side_over_alone_median": statistics.median(slower),
        "workers_busy_share_median": statistics.median(busy),
        "rounds": [list(done.values()) for done in rounds],
    }


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    options = parser.parse_args()
    rounds = []
    with tempfile.TemporaryDirectory(prefix="efficiency-") as temporary:
        inputs = Path(temporary) / "inputs"
        prepare(inputs)
        for index in range(options.rounds):
            order = WORKERS if index % 2 == 0 else WORKERS[::-1]
            done = {workers: run(inputs, workers) for workers in order}
            rounds.append({workers: done[workers] for workers in WORKERS})
            print({workers: round(done[workers]["wall_s"], 1) for workers in WORKERS}, flush=True)
    figures = summarise(rounds)
    settings = {"set": "starter", "sizes": SMALL, "rounds": options.rounds, "cores": os.cpu_count()}
    compared = (
        "the whole command that makes a data set from nothing, cluster and interpreter started within: "
        "wall seconds with one worker over those with two, median of the rounds"
    )
    conclude("efficiency", figures, settings, compared)
