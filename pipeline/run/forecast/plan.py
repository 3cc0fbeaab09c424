"""``objectfolder plan``: the tasks and costs of a run before it starts, and afterwards its real costs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from pipeline.cluster.places import read_place
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.records import read_table
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import STAGES
from pipeline.run.flow_progress import duration
from pipeline.run.forecast.planning import (
    Machines,
    Plan,
    StagePlan,
    WallTime,
    machines_of,
    plan,
    plan_for_count,
    side_by_side,
)
from pipeline.run.run_record import read_record, records

PLAN = Path(".objectfolder/plan.json")


@dataclass(frozen=True)
class Comparison:
    """The cost of a stage in the runs after a plan.

    Parameters
    ----------
    planned, computed, failed
        Tasks.
    planned_cpu_s, took_cpu_s
        CPU seconds: planned for all tasks; taken by those that were computed.
    memory_bytes, peak_bytes
        Planned as most, and the largest seen.
    above
        Tasks whose peak was above what was planned as most.
    planned_bytes, product_bytes
        Of products: planned for all tasks; of those that were computed.
    """

    planned: int
    computed: int
    failed: int
    planned_cpu_s: float
    took_cpu_s: float
    memory_bytes: int
    peak_bytes: int
    above: int
    planned_bytes: int
    product_bytes: int


def show_plan(
    root: Path,
    *,
    objects: Path | None = None,
    workers: Sequence[int] = (),
    count: int | None = None,
    as_json: bool = False,
) -> None:
    """Print the plan of a data set, and keep it.

    Parameters
    ----------
    root
        Root of the data set.
    objects
        Table of objects; that of ``params.yaml`` without it.
    workers
        Also with these numbers of workers.
    count
        For this number of objects that do not exist yet; such a plan is not kept.
    as_json
        Print all of it as JSON.
    """
    parameters = read_parameters(root / "params.yaml")
    machines = machines_of(read_place(root))
    if count:
        made = plan_for_count(root, parameters, count, machines, workers)
    else:
        listed = parameters.objects
        if objects:
            listed = replace(listed, table=str(objects), only=())
        rows = read_table(root, listed).selected(listed.only).rows
        made = plan(root, parameters, rows, machines, workers)
        write_plan(root, made)
    print(json.dumps(asdict(made), indent=1) if as_json else table(made))


def show_comparison(root: Path, *, as_json: bool = False) -> None:
    """Print the costs of the runs since the last plan, beside those planned."""
    kept = read_plan(root)
    found, wall_s = compare(root, kept)
    if as_json:
        shown = {"stages": {name: asdict(one) for name, one in found.items()}, "wall_s": wall_s}
        print(json.dumps(shown, indent=1))
    else:
        print(comparison_table(kept, found, wall_s))


def table(made: Plan) -> str:
    """Return a plan for people."""
    lines = [
        f"{made.objects} object{'s' * (made.objects != 1)}, size {made.size}",
        "",
        f"{'stage':<10}{'kept':>8}{'restored':>10}{'compute':>9}{'CPU time':>12}"
        f"{'peak memory':>13}{'at a time':>11}{'products':>11}",
    ]
    for name, one in made.stages.items():
        beside = side_by_side(one.memory_bytes, made.machines) * made.machines.hosts if one.computed else ""
        lines.append(
            f"{name:<10}{one.kept:>8}{one.restored:>10}{one.computed:>9}{duration(one.cpu_s):>12}"
            f"{one.memory_bytes / 1e9:>10.2f} GB{beside:>11}{size(one.product_bytes):>11}"
        )
    total = sum(one.cpu_s for one in made.stages.values())
    made_bytes = sum(one.product_bytes for one in made.stages.values())
    lines += [
        f"{'all':<10}{'':>27}{duration(total):>12}{'':>24}{size(made_bytes):>11}",
        "",
        f"The memo grows by {size(made.memo_bytes)}. Peak memory and tasks at a time are of one host"
        f" with {made.machines.memory_bytes / 1e9:.1f} GB for tasks.",
    ]
    for number, wall in made.wall.items():
        here = " (this place)" if number == made.machines.workers else ""
        lines.append(
            f"{number} worker{'s' * (number > 1)}{here}: about {duration(wall.expected_s)},"
            f" at least {duration(wall.at_least_s)}"
        )
    lines.append(
        f"No number of workers is faster than {duration(made.chain_s)}, the longest chain of an object."
    )
    return "\n".join(lines)


def comparison_table(kept: Plan, found: Mapping[str, Comparison], wall_s: float) -> str:
    """Return a comparison for people."""
    lines = [
        f"plan of {kept.time}, {kept.objects} objects",
        "",
        f"{'stage':<10}{'planned':>9}{'computed':>10}{'failed':>8}{'CPU planned':>13}{'taken':>9}"
        f"{'a task':>8}{'memory planned':>16}{'largest':>10}{'above':>7}{'bytes planned':>15}{'made':>10}",
    ]
    for name, one in found.items():
        ratio = _ratio(one)
        lines.append(
            f"{name:<10}{one.planned:>9}{one.computed:>10}{one.failed:>8}{duration(one.planned_cpu_s):>13}"
            f"{duration(one.took_cpu_s):>9}{f'x {ratio:.2f}' if ratio else '':>8}"
            f"{one.memory_bytes / 1e9:>13.2f} GB{one.peak_bytes / 1e9:>7.2f} GB{one.above:>7}"
            f"{size(one.planned_bytes):>15}{size(one.product_bytes):>10}"
        )
    planned = kept.wall[kept.machines.workers].expected_s
    lines += [
        "",
        f"planned {duration(planned)} with {kept.machines.workers} workers;"
        f" the runs since then took {duration(wall_s)}",
    ]
    return "\n".join(lines)


def compare(
    root: Path, kept: Plan, stages: Mapping[str, Stage] = STAGES
) -> tuple[dict[str, Comparison], float]:
    """Return the cost of each stage in the runs since a plan was made, and their wall seconds."""
    begin = datetime.fromisoformat(kept.time)
    tasks: dict[str, list[dict[str, Any]]] = {name: [] for name in kept.stages}
    wall_s = 0.0
    for path in records(root):
        lines = read_record(path)
        times = [datetime.fromisoformat(line["time"]) for line in lines if "time" in line]
        if not times or times[0] < begin:
            continue
        wall_s += (times[-1] - times[0]).total_seconds()
        for line in lines:
            if line.get("event") == "task" and line.get("stage") in tasks:
                tasks[line["stage"]].append(line)
    return {
        name: _compared(root, stages[name], one, tasks[name]) for name, one in kept.stages.items()
    }, wall_s


def _compared(root: Path, stage: Stage, planned: StagePlan, tasks: Sequence[dict[str, Any]]) -> Comparison:
    done = [task for task in tasks if task["outcome"] == "computed"]
    peaks = [int(task["peak_memory_mb"] * 1e6) for task in done]
    return Comparison(
        planned.computed,
        len(done),
        len(tasks) - len(done),
        planned.cpu_s,
        sum(task["cpu_s"] for task in done),
        planned.memory_bytes,
        max(peaks, default=0),
        sum(peak > planned.memory_bytes for peak in peaks),
        planned.product_bytes,
        sum(
            path.stat().st_size
            for task in done
            for path in stage.targets(root, task["object"])
            if path.is_file()
        ),
    )


def _ratio(one: Comparison) -> float | None:
    """Return CPU seconds of a task taken over planned."""
    if not (one.computed and one.planned and one.planned_cpu_s):
        return None
    return (one.took_cpu_s / one.computed) / (one.planned_cpu_s / one.planned)


def write_plan(root: Path, made: Plan) -> None:
    """Keep a plan for `compare`."""
    (root / PLAN).parent.mkdir(parents=True, exist_ok=True)
    (root / PLAN).write_text(json.dumps(asdict(made)) + "\n")


def read_plan(root: Path) -> Plan:
    """Return the plan that was made last.

    Raises
    ------
    InputError
        No plan was kept, or it cannot be read.
    """
    try:
        content = json.loads((root / PLAN).read_text())
        stages = {name: StagePlan(**one) for name, one in content["stages"].items()}
        wall = {int(number): WallTime(**one) for number, one in content["wall"].items()}
        machines = Machines(**content["machines"])
        return Plan(**{**content, "stages": stages, "wall": wall, "machines": machines})
    except FileNotFoundError as error:
        raise InputError(str(PLAN), "there is no plan", "Run `objectfolder plan` before a run.") from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(str(PLAN), f"cannot be read ({error})", "Run `objectfolder plan`.") from error


def size(count: float) -> str:
    """Return bytes with a unit, for people."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"
