"""Overhead of the factory with a thousand objects: runs with nothing or one object to do, and the status.

Run as ``python -m bench overhead``. The stages, their code and DVC are the real ones, the task bodies
trivial (`bench.factory.overhead_repository`). The rival has a DVC stage for every object. CPU seconds include
child processes; on a busy machine they grow, and so does the measure beside them, importing numpy.
"""

import json
import shutil
import statistics
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from bench.factory.overhead_repository import REPOSITORY, OverheadRepository, stage_per_object
from bench.record import arguments, conclude, cpu_seconds
from pipeline.dataset.stages import STAGES

BARS = {"nothing to do": 3.0, "one object changed": 8.0, "status": 2.0, "status of DVC": 2.0}
Act = Callable[[], object]


def seconds_of(act: Act) -> float:
    """Return the CPU seconds of what `act` runs."""
    start = cpu_seconds()
    act()
    return cpu_seconds() - start


def measure(root: Path, objects: int, rounds: int) -> dict[str, Any]:
    """Return CPU seconds of every act, each round one after the other."""
    repository = OverheadRepository(root, objects)
    made = seconds_of(lambda: repository.run(*populate(root)))
    print(f"products made: {made:.1f} CPU-s", flush=True)
    first = seconds_of(lambda: repository.run("dvc", "repro"))
    print(f"first repro: {first:.1f} CPU-s", flush=True)
    sizes = iter(range(1000))

    def change() -> None:
        repository.write_mesh(repository.ids[objects // 2], 0.5 + next(sizes) * 1e-3)

    def forget() -> None:
        for name in ("verified.json", "code.json"):
            (root / ".objectfolder" / name).unlink(missing_ok=True)

    def status() -> None:
        states = json.loads(repository.run("python", "-m", "pipeline.cli", "status", "--json").stdout)
        if len(states) != len(STAGES) * objects or any(entry["state"] != "current" for entry in states):
            raise RuntimeError("not all is current")

    def dvc_status() -> None:
        if "up to date" not in repository.run("dvc", "status").stdout:
            raise RuntimeError("DVC does not find all current")

    acts: dict[str, tuple[Act | None, Act]] = {
        "nothing to do": (None, lambda: repository.run("dvc", "repro")),
        "one object changed": (change, lambda: repository.run("dvc", "repro")),
        "status of DVC": (None, dvc_status),
        "status": (None, status),
        "status, files read anew": (forget, status),
        "importing numpy": (None, lambda: repository.run("python", "-c", "import numpy")),
    }
    seconds: dict[str, list[float]] = {name: [] for name in acts}
    for _ in range(rounds):
        for name, (prepare, act) in acts.items():
            if prepare is not None:
                prepare()
            seconds[name].append(seconds_of(act))
            print(f"{name}: {seconds[name][-1]:.2f} CPU-s", flush=True)
    return {"objects": objects, "stages": len(STAGES), "products_found_by_dvc_cpu_s": first, "cpu_s": seconds}


def populate(root: Path) -> tuple[str, ...]:
    """Return the command that makes all products."""
    script = REPOSITORY / "bench" / "factory" / "overhead_populate.py"
    return "env", f"PYTHONPATH={root}", "python", str(script)


def measure_rival(root: Path, objects: int) -> dict[str, Any]:
    """Return CPU seconds of one DVC stage per object, for a few objects and one of the six products."""
    repository = OverheadRepository(root, objects)
    command = "cp meshes/${item.name}.obj made/${item.name}.txt"
    stages = stage_per_object(repository.ids, command)
    (root / "dvc.yaml").write_text(yaml.safe_dump(stages))
    (root / "made").mkdir()
    figures: dict[str, Any] = {"objects": objects, "stages": 1}
    figures["first_cpu_s"] = seconds_of(lambda: repository.run("dvc", "repro"))
    figures["nothing_to_do_cpu_s"] = seconds_of(lambda: repository.run("dvc", "repro"))
    repository.write_mesh(repository.ids[0], 0.7)
    figures["one_changed_cpu_s"] = seconds_of(lambda: repository.run("dvc", "repro"))
    print(f"rival: {figures}", flush=True)
    return figures


def measure_dvc(root: Path) -> float:
    """Return CPU seconds of a repro of no stages."""
    repository = OverheadRepository(root, 0)
    (root / "dvc.yaml").write_text("stages: {}\n")
    return seconds_of(lambda: repository.run("dvc", "repro"))


def summary(ours: dict[str, Any], rival: dict[str, Any], start: float) -> dict[str, Any]:
    """Return medians against the bars, and the rival's cost an object carried on to as many objects."""
    medians = {name: statistics.median(values) for name, values in ours["cpu_s"].items()}
    share = ours["stages"] * ours["objects"] / rival["objects"]
    return {
        **ours,
        "median_cpu_s": medians,
        "bars_cpu_s": BARS,
        "meets_bar": {name: medians[name] <= bar for name, bar in BARS.items()},
        "rival": rival,
        "rival_extrapolated_cpu_s": {
            key.removesuffix("_cpu_s").replace("_", " "): start + (rival[key] - start) * share
            for key in ("first_cpu_s", "nothing_to_do_cpu_s", "one_changed_cpu_s")
        },
        "dvc_alone_cpu_s": start,
    }


def main() -> None:
    """Measure, write the results and say them."""
    parser = arguments(__doc__)
    parser.add_argument("--objects", type=int, default=1000)
    parser.add_argument("--rival-objects", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    work = Path(tempfile.mkdtemp(prefix="overhead-"))
    try:
        ours = measure(work / "ours", given.objects, given.rounds)
        rival = measure_rival(work / "rival", given.rival_objects)
        start = measure_dvc(work / "none")
    finally:
        shutil.rmtree(work, ignore_errors=True)
    figures = summary(ours, rival, start)
    conclude(
        "overhead",
        figures,
        {**vars(given), "python": sys.version.split()[0]},
        "CPU seconds, child processes included, of `dvc repro`, `dvc status` and `objectfolder status` over "
        "trivial tasks; the rival is one DVC stage per object, one product of six, carried on in proportion.",
    )
    print(json.dumps({key: figures[key] for key in ("median_cpu_s", "rival_extrapolated_cpu_s")}))
