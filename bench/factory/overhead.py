"""Overhead of the factory with a thousand objects: runs with nothing or one object to do, and the status.

Run as ``python -m bench overhead``. The stages, their code and DVC are the real ones, the task bodies
trivial (`bench.factory.overhead_repository`). CPU seconds include child processes; on a busy machine they
grow, and so does the measure beside them, importing numpy.
"""

import json
import statistics
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.factory.overhead_repository import REPOSITORY, OverheadRepository
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
    making_s = seconds_of(lambda: repository.run(*populate(root)))
    print(f"products made: {making_s:.1f} CPU-s", flush=True)
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


def summary(ours: dict[str, Any]) -> dict[str, Any]:
    """Return medians against the bars."""
    medians = {name: statistics.median(values) for name, values in ours["cpu_s"].items()}
    return {
        **ours,
        "median_cpu_s": medians,
        "bars_cpu_s": BARS,
        "meets_bar": {name: medians[name] <= bar for name, bar in BARS.items()},
    }


def main() -> None:
    """Measure, write the results and say them."""
    parser = arguments(__doc__)
    parser.add_argument("--objects", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="overhead-", ignore_cleanup_errors=True) as work:
        figures = summary(measure(Path(work) / "ours", options.objects, options.rounds))
    conclude(
        "overhead",
        figures,
        vars(options),
        "CPU seconds, child processes included, of `dvc repro`, `dvc status` and `objectfolder status` over "
        "trivial tasks.",
    )
    print(json.dumps(figures["median_cpu_s"]))
