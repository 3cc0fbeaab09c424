"""Makespan over what no schedule can beat, on measured costs, by the order in which tasks start.

    python -m bench.schedule [--costs FILE] [--modes FOLDER]

FILE is the ``.objectfolder/costs.csv`` of a data set, or a table as the default,
``pipeline/run/forecast/known_costs.csv``. A task of an object that was never run takes what that of
another took, one of the package's where the stage has none (how many is in the result); FOLDER with the
rows of `bench.scans` says what modes took where the costs do not.

The bound is max(total / workers, longest chain of an object). Tasks are simulated in virtual time through
the real dispatch. "Dask's order" is what Dask does at best: tasks in the order in which they were submitted,
stage after stage, none waiting where it could run. With --dask, a local cluster of Dask, all defaults, runs
tasks that sleep as well: on an idle machine only, for wall seconds are what it measures.
"""

import argparse
import json
import random
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from bench.record import RESULTS, write
from pipeline.dataset.stages import STAGES
from pipeline.run.forecast.drawn_objects import Costs, drawn_objects, known_objects
from pipeline.run.forecast.estimates import fit
from pipeline.run.forecast.known_costs import PACKAGED, KnownCost, costs_of, packaged_costs
from pipeline.run.forecast.loads import Loads
from pipeline.run.forecast.simulated_flow import Work, lower_bound_s, run_flow, run_stage_by_stage
from pipeline.run.forecast.simulation import hosts

matplotlib.use("Agg")

WORKERS = (8, 64, 512)
SPLITS = 5
BAR = 1.05
MANY = 1000
SLEPT_BOUND_S = 20.0  # what the bound is scaled to where tasks sleep
FOLLOWS = {name: stage.follows for name, stage in STAGES.items()}
COMPARED = (
    "Makespan of all tasks of all objects over the lower bound max(total CPU seconds / workers, longest "
    "chain of tasks of one object): stage by stage (each stage waits for all of the one before), one flow "
    "over all stages with seconds as estimated from the other half of the objects, with medians for all, and "
    "with true seconds known, objects in listed order, and in the order of Dask"
)
WAYS = (
    "stage by stage",
    "listed order",
    "Dask's order",
    "flow, medians",
    "flow, estimates",
    "flow, true seconds",
    "Dask",
)

Known = Mapping[str, Costs]
Works = dict[str, dict[str, Work]]


def main() -> None:
    parser = argparse.ArgumentParser(description="makespan over its lower bound on measured costs")
    parser.add_argument("--costs", type=Path, default=PACKAGED, help="costs of a data set")
    parser.add_argument("--modes", type=Path, help="rows of bench.scans, for modes without a cost")
    parser.add_argument("--dask", action="store_true", help="run tasks that sleep on a real cluster too")
    given = parser.parse_args()
    costs = read_costs(given.costs)
    scans: list[KnownCost] = []
    if given.modes:
        scans = modes_of_scans(costs, given.modes, given.costs)
        costs += scans
    measured = Counter(cost.stage for cost in costs)
    lacking = [cost for cost in packaged_costs() if not measured[cost.stage]]
    listed = {cost.object_id for cost in costs}
    everything = known_objects([*costs, *lacking], list(STAGES), seed=0)
    known = {name: of_stage for name, of_stage in everything.items() if name in listed}
    rows = []
    for workers in WORKERS:
        row = measure(known, workers)
        if workers <= 64 and given.dask:
            row["ratio"]["Dask"] = slept(works(known, known), workers)
        rows.append(row)
        print(json.dumps(row), flush=True)
    many = drawn_objects(known, MANY, seed=1)
    more = [measure(many, workers, splits=1) for workers in WORKERS]
    figures = {
        "objects": len(known),
        "modes_from_rows_of_scans": len(scans),
        "tasks": sum(map(len, known.values())),
        "drawn_because_not_measured": {
            stage: len(known) - measured[stage] for stage in STAGES if measured[stage] < len(known)
        },
        "cpu_s": {stage: _spread([known[name][stage].cpu_s for name in known]) for stage in STAGES},
        "bar": BAR,
        "makespan": rows,
        f"makespan_of_{MANY}_drawn_from_them": more,
    }
    settings = {
        "seconds": "CPU seconds of each task, one thread a task; none lost between tasks",
        "estimates": f"median of {SPLITS} random halves, each estimated from the other",
        "dask": f"LocalCluster(processes=False), a thread a worker, defaults; bound of {SLEPT_BOUND_S} s",
    }
    write("schedule", figures, settings, COMPARED)
    draw(rows, more, len(known))


def read_costs(path: Path) -> list[KnownCost]:
    if path.resolve() == PACKAGED.resolve():
        return list(packaged_costs())
    root = path.resolve().parents[1]
    loads = Loads(root)
    return [
        replace(cost, load=loads.of(cost.stage, cost.object_id))
        for cost in costs_of(root)
        if cost.stage in STAGES
    ]


def modes_of_scans(costs: list[KnownCost], folder: Path, path: Path) -> list[KnownCost]:
    """Costs of modes for objects that have others, but not these."""
    loads = Loads(path.resolve().parents[1])
    there = {cost.object_id for cost in costs if cost.stage == "modes"}
    found = []
    for name in sorted({cost.object_id for cost in costs} - there):
        row = folder / f"{name}.json"
        if row.is_file():
            seconds = json.loads(row.read_text())["cpu_s"]
            found.append(KnownCost(name, "modes", seconds, seconds, 0, loads.of("modes", name)))
    return found


def works(known: Known, expected: Known, high: Mapping[str, Mapping[str, float]] | None = None) -> Works:
    return {
        name: {
            stage: Work(
                cost.cpu_s,
                expected[name][stage].cpu_s,
                high[name][stage] if high else expected[name][stage].cpu_s,
            )
            for stage, cost in costs.items()
        }
        for name, costs in known.items()
    }


def measure(known: Known, workers: int, splits: int = SPLITS) -> dict[str, Any]:
    slots = hosts(workers // 8, 8)
    true = works(known, known)
    bound = lower_bound_s(true, FOLLOWS, workers)
    medians = {stage: float(np.median([costs[stage].cpu_s for costs in known.values()])) for stage in STAGES}
    same = {
        name: {stage: replace(cost, cpu_s=medians[stage]) for stage, cost in costs.items()}
        for name, costs in known.items()
    }
    estimated, apart = [], []
    for seed in range(splits):
        guessed = works(known, *estimates(known, seed))
        estimated.append(run_flow(guessed, FOLLOWS, slots).makespan_s / bound)
        apart.append(run_stage_by_stage(guessed, FOLLOWS, slots).makespan_s / bound)
    return {
        "workers": workers,
        "bound_s": bound,
        "longest_chain_s": lower_bound_s(true, FOLLOWS, 10**9),
        "ratio": {
            "stage by stage": float(np.median(apart)),
            "listed order": run_flow(true, FOLLOWS, slots, in_listed_order=True).makespan_s / bound,
            "Dask's order": run_flow(in_order_of_stages(true), FOLLOWS, slots).makespan_s / bound,
            "flow, medians": run_flow(works(known, same), FOLLOWS, slots).makespan_s / bound,
            "flow, estimates": float(np.median(estimated)),
            "flow, true seconds": run_flow(true, FOLLOWS, slots).makespan_s / bound,
        },
        "estimates_of_each_split": estimated,
    }


def in_order_of_stages(objects: Works) -> Works:
    """Tasks with high seconds such that all of a stage go before the next, and objects as they are listed."""
    # Of a chain, what is behind adds to each task: the stage dwarfs all that can be behind it.
    heights = {stage: 1e4 ** (len(FOLLOWS) - place) for place, stage in enumerate(FOLLOWS)}
    return {
        name: {
            stage: replace(task, high_s=heights[stage] * (2 - index / len(objects)))
            for stage, task in tasks.items()
        }
        for index, (name, tasks) in enumerate(objects.items())
    }


def estimates(known: Known, seed: int) -> tuple[Known, dict[str, dict[str, float]]]:
    """Expected and high seconds of each object from a half of the objects that it is not in."""
    names = sorted(known)
    random.Random(seed).shuffle(names)
    halves = names[::2], names[1::2]
    expected: dict[str, Costs] = {}
    high: dict[str, dict[str, float]] = {}
    for own, other in (halves, halves[::-1]):
        models = {stage: fit([known[name][stage] for name in other]) for stage in STAGES}
        for name in own:
            guesses = {stage: models[stage].of(known[name][stage].load) for stage in STAGES}
            expected[name] = {
                stage: replace(known[name][stage], cpu_s=guess.cpu_s) for stage, guess in guesses.items()
            }
            high[name] = {stage: guess.cpu_s * models[stage].spread for stage, guess in guesses.items()}
    return expected, high


def slept(objects: Works, workers: int) -> float:
    """Makespan over the bound of tasks that sleep, placed by Dask as it comes."""
    from distributed import Client, LocalCluster, wait

    bound = lower_bound_s(objects, FOLLOWS, workers)
    scale = SLEPT_BOUND_S / bound
    with (
        LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=False, dashboard_address=None, memory_limit=0
        ) as cluster,
        Client(cluster) as client,
    ):
        client.wait_for_workers(workers)
        begin = time.perf_counter()
        futures: dict[tuple[str, str], Any] = {}
        for stage in FOLLOWS:
            for name, tasks in objects.items():
                before = [futures[name, other] for other in sorted(FOLLOWS[stage])]
                futures[name, stage] = client.submit(
                    _sleep, tasks[stage].true_s * scale, before, key=f"{stage}-{name}", pure=False
                )
        wait(list(futures.values()))
        return (time.perf_counter() - begin) / SLEPT_BOUND_S


def _sleep(seconds: float, before: list[None]) -> None:
    time.sleep(seconds)


def _spread(values: list[float]) -> dict[str, float]:
    levels = {"least": 0, "median": 50, "p90": 90, "most": 100}
    return {name: float(np.percentile(values, level)) for name, level in levels.items()} | {
        "sum": float(sum(values))
    }


def draw(rows: list[dict[str, Any]], more: list[dict[str, Any]], objects: int) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(11, 4), sharey=True)
    for axis, table, title in zip(
        axes, (rows, more), (f"{objects} objects", f"{MANY} drawn from them"), strict=True
    ):
        present = [way for way in WAYS if any(way in row["ratio"] for row in table)]
        for place, way in enumerate(present):
            found = [(index, row["ratio"][way]) for index, row in enumerate(table) if way in row["ratio"]]
            x = [index + (place - len(present) / 2) / (len(present) + 1) for index, _ in found]
            axis.bar(x, [ratio for _, ratio in found], 0.9 / (len(present) + 1), label=way)
        axis.axhline(BAR, color="black", linewidth=0.8, linestyle="--")
        axis.set_xticks(range(len(table)), [f"{row['workers']} workers" for row in table])
        axis.set_ylim(0.9)
        axis.set_title(title)
    axes[0].set_ylabel("makespan / lower bound")
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(RESULTS / "schedule.png", dpi=120)


if __name__ == "__main__":
    main()
