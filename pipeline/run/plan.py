"""``objectfolder plan``: the tasks and costs of a run before it starts.

Objects are counted as `pipeline.run.status` finds them: current ones are kept, those in DVC's cache restored,
the rest computed; so is, at most, whatever waits for an input that does not exist yet. Seconds, memory and
bytes are those of `pipeline.run.estimates`.

No schedule is faster than the work shared evenly, or than the longest chain of tasks of one object. The
expected wall time is the same bound with the work of each task shared among as many as fit into memory
beside each other.
"""

import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.filesize import decimal

from pipeline.cluster.places import Place, read_place
from pipeline.dataset.counts import columns, counted
from pipeline.dataset.parameters import ObjectsParameters, Parameters, read_parameters
from pipeline.dataset.records import read_table
from pipeline.dataset.selection import read_selection
from pipeline.dataset.stage import Row, Stage
from pipeline.dataset.stages import STAGES
from pipeline.run.estimates import Estimate, Estimates
from pipeline.run.flow_progress import duration
from pipeline.run.status import CURRENT, WAITING, Status, status
from pipeline.sandbox.host_memory import total_bytes
from pipeline.store.product_cache import ProductCache

MEMORY_SHARE = 0.9  # of a host, that tasks may take

Tasks = Mapping[str, Mapping[str, Estimate]]  # to compute, by object and stage


@dataclass(frozen=True)
class Machines:
    """Hosts that are alike: how many, tasks at a time and memory of each."""

    hosts: int
    slots: int
    memory_bytes: int

    @property
    def workers(self) -> int:
        """Tasks at a time on all of them."""
        return self.hosts * self.slots

    def beside(self, memory_bytes: int) -> int:
        """Return how many tasks that need this memory run at a time on a host; at least one."""
        return max(1, min(self.slots, self.memory_bytes // max(1, memory_bytes)))


@dataclass(frozen=True)
class StagePlan:
    """Objects of a stage kept, restored and computed; of the tasks: seconds, largest peak, bytes made."""

    kept: int
    restored: int
    computed: int
    cpu_s: float
    memory_bytes: int
    product_bytes: int


@dataclass(frozen=True)
class WallTime:
    """Seconds that no schedule can beat, and that are expected."""

    at_least_s: float
    expected_s: float


@dataclass(frozen=True)
class Plan:
    """The tasks and costs of a run.

    Parameters
    ----------
    size, objects
        Size of ``params.yaml`` it is for, and number of objects.
    stages
        By name.
    wall
        Wall time by number of workers.
    chain_s
        Expected seconds of the longest chain of tasks of one object: no number of workers is faster.
    machines
        Where it would run.
    """

    size: str
    objects: int
    stages: Mapping[str, StagePlan]
    wall: Mapping[int, WallTime]
    chain_s: float
    machines: Machines

    def __str__(self) -> str:
        head = ("stage", "kept", "restored", "compute", "CPU time", "peak memory", "products")
        rows = [
            (name, *map(str, (task.kept, task.restored, task.computed)), duration(task.cpu_s),
             decimal(task.memory_bytes), decimal(task.product_bytes))
            for name, task in self.stages.items()
        ]  # fmt: skip
        cpu_s = sum(task.cpu_s for task in self.stages.values())
        made_bytes = sum(task.product_bytes for task in self.stages.values())
        rows.append(("all", "", "", "", duration(cpu_s), "", decimal(made_bytes)))
        lines = [f"{counted(self.objects, 'object')}, size {self.size}", "", *columns([head, *rows]), ""]
        for number, wall in self.wall.items():
            mark = " (this place)" if number == self.machines.workers else ""
            lines.append(
                f"{counted(number, 'worker')}{mark}: about {duration(wall.expected_s)},"
                f" at least {duration(wall.at_least_s)}"
            )
        chain = f"No number of workers is faster than {duration(self.chain_s)}"
        return "\n".join([*lines, f"{chain}, the longest chain of an object."])


def plan_data_set(
    root: Path, objects: Path | None = None, workers: Sequence[int] = (), count: int | None = None
) -> Plan:
    """Return the plan of a data set, or of another `objects` table, also for other numbers of `workers`.

    With a `count` it is for this number of objects that do not exist yet.
    """
    parameters = read_parameters(root / "params.yaml")
    machines = machines_of(read_place(root))
    if count:
        return plan_for_count(root, parameters, count, machines, workers)
    table_source = ObjectsParameters(str(objects)) if objects else parameters.objects
    rows = read_table(root, table_source).selected(() if objects else read_selection(root)).rows
    return plan(root, parameters, rows, machines, workers)


def plan(
    root: Path,
    parameters: Parameters,
    rows: Mapping[str, Row],
    machines: Machines,
    workers: Sequence[int] = (),
    stages: Sequence[Stage] = tuple(STAGES.values()),
) -> Plan:
    """Return the plan for the listed objects as they stand, also for other numbers of `workers`."""
    estimates, cache = Estimates(root, parameters), ProductCache(root)
    by_name = {stage.name: stage for stage in stages}
    counts: Counter[tuple[str, str]] = Counter()
    tasks: dict[str, dict[str, Estimate]] = {}
    for task in status(root, stages, parameters, rows):
        if task.object_id not in rows:
            continue  # no longer listed
        if task.state == CURRENT:
            counts[task.stage, "kept"] += 1
        elif _is_cached(cache, root, by_name[task.stage], task):
            counts[task.stage, "restored"] += 1
        else:
            tasks.setdefault(task.object_id, {})[task.stage] = estimates.of(task.stage, task.object_id)
    return _plan(parameters.size, len(rows), by_name, tasks, machines, workers, counts)


def plan_for_count(
    root: Path, parameters: Parameters, count: int, machines: Machines, workers: Sequence[int] = ()
) -> Plan:
    """Return the plan for `count` objects that do not exist yet, each with the mean cost of every stage."""
    estimates = Estimates(root, parameters)
    mean = {"": {name: estimates.mean(name) for name in STAGES}}
    return _plan(parameters.size, count, STAGES, mean, machines, workers, times=count)


def machines_of(place: Place) -> Machines:
    """Return what a place offers, with this machine's size where the place does not say."""
    hosts, tasks, memory_bytes = place.capacity()
    return Machines(hosts, tasks or os.cpu_count() or 1, memory_bytes or int(MEMORY_SHARE * total_bytes()))


def _is_cached(cache: ProductCache, root: Path, stage: Stage, task: Status) -> bool:
    is_known = task.state != WAITING and task.wanted != ""
    return is_known and bool(cache.files(task.wanted, stage.targets(root, task.object_id)))


def _plan(
    size: str,
    objects: int,
    stages: Mapping[str, Stage],
    tasks: Tasks,
    machines: Machines,
    workers: Sequence[int],
    counts: Mapping[tuple[str, str], int] | None = None,
    times: float = 1.0,
) -> Plan:
    """Return the plan for tasks, each counted `times` times."""
    chain_s = max((_chain_s(stages, by_stage) for by_stage in tasks.values()), default=0.0)
    every = [task for by_stage in tasks.values() for task in by_stage.values()]
    wall = {}
    for number in sorted({1, machines.workers, *workers}):
        hosts = math.ceil(number / machines.slots)
        work_s = times * sum(estimate.cpu_s for estimate in every) / number
        bounded_s = times * sum(
            estimate.cpu_s / min(number, hosts * machines.beside(estimate.memory_bytes)) for estimate in every
        )
        wall[number] = WallTime(max(work_s, chain_s), max(bounded_s, chain_s))
    by_name = {name: _stage_plan(name, tasks, counts or {}, times) for name in stages}
    return Plan(size, objects, by_name, wall, chain_s, machines)


def _stage_plan(name: str, tasks: Tasks, counts: Mapping[tuple[str, str], int], times: float) -> StagePlan:
    costs = [by_stage[name] for by_stage in tasks.values() if name in by_stage]
    return StagePlan(
        counts.get((name, "kept"), 0),
        counts.get((name, "restored"), 0),
        round(len(costs) * times),
        sum(task.cpu_s for task in costs) * times,
        max((task.memory_bytes for task in costs), default=0),
        round(sum(task.product_bytes for task in costs) * times),
    )


def _chain_s(stages: Mapping[str, Stage], by_stage: Mapping[str, Estimate]) -> float:
    ends: dict[str, float] = {}
    for name, stage in stages.items():
        before = max((ends.get(earlier, 0.0) for earlier in stage.follows), default=0.0)
        ends[name] = before + (by_stage[name].cpu_s if name in by_stage else 0.0)
    return max(ends.values(), default=0.0)
