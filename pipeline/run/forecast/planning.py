"""The tasks and costs of a run, before it starts.

Objects are counted as `pipeline.run.status` finds them: what is current is kept, what is not but lies in the
memo is restored, the rest is computed; so is, at most, whatever waits for an input that does not exist yet.
Seconds, memory and bytes are those of `pipeline.run.forecast.estimates`.

No schedule is faster than the work shared evenly, or than the longest chain of tasks of one object. The
expected wall time is the same bound with the work of each task shared among as many as fit into memory
beside each other.
"""

import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.provenance import fingerprint
from pipeline.cluster.places import Place
from pipeline.dataset.parameters import Parameters
from pipeline.dataset.stage import Row, Stage
from pipeline.dataset.stages import STAGES
from pipeline.dataset.verified import Verified
from pipeline.run.costs import known_costs
from pipeline.run.forecast.estimates import (
    ENOUGH_ROWS,
    MEMORY_MARGIN,
    Estimate,
    Estimates,
    Taken,
    last_taken,
    packaged_costs,
    scales,
)
from pipeline.run.status import CURRENT, WAITING, Status, status
from pipeline.sandbox.host_memory import total_bytes
from pipeline.store import memo

MEMORY_SHARE = 0.9  # of a host, that tasks may take

Tasks = Mapping[str, Mapping[str, Estimate]]  # to compute, by object and stage


@dataclass(frozen=True)
class StagePlan:
    """The tasks of a stage, and their costs.

    Parameters
    ----------
    kept, restored, computed
        Objects.
    cpu_s
        Seconds of all its tasks.
    memory_bytes
        Largest peak of a task, on the high side.
    product_bytes
        Of the products to compute.
    """

    kept: int
    restored: int
    computed: int
    cpu_s: float
    memory_bytes: int
    product_bytes: int


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
    time
        When it was made, UTC.
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
    memo_bytes
        What the memo grows by, at most its cap.
    """

    time: str
    size: str
    objects: int
    stages: Mapping[str, StagePlan]
    wall: Mapping[int, WallTime]
    chain_s: float
    machines: Machines
    memo_bytes: int


def plan(
    root: Path,
    parameters: Parameters,
    rows: Mapping[str, Row],
    machines: Machines,
    workers: Sequence[int] = (),
    stages: Sequence[Stage] = tuple(STAGES.values()),
) -> Plan:
    """Return the plan for the listed objects as they stand.

    Parameters
    ----------
    root
        Root of the data set.
    parameters, rows
        Of the run; the listed objects.
    machines
        Where it would run.
    workers
        Other numbers of workers to give the wall time for.
    stages
        Each after those whose products it reads.
    """
    estimates = Estimates(root, parameters)
    verified = Verified(root)
    by_name = {stage.name: stage for stage in stages}
    counts: Counter[tuple[str, str]] = Counter()
    tasks: dict[str, dict[str, Estimate]] = {}
    for one in status(root, stages, parameters, rows):
        row = rows.get(one.object_id)
        if row is None:
            continue  # no longer listed
        if one.state == CURRENT:
            counts[one.stage, "kept"] += 1
        elif one.state != WAITING and _in_memo(root, parameters, by_name[one.stage], one, row, verified):
            counts[one.stage, "restored"] += 1
        else:
            tasks.setdefault(one.object_id, {})[one.stage] = estimates.of(one.stage, one.object_id)
    return _plan(parameters.size, len(rows), by_name, tasks, machines, workers, counts)


def plan_for_count(
    root: Path, parameters: Parameters, count: int, machines: Machines, workers: Sequence[int] = ()
) -> Plan:
    """Return the plan for `count` objects that do not exist yet and are like those known.

    These are the objects of this data set if enough of them have costs of every stage, else the packaged
    ones.
    """
    own = _complete(last_taken(known_costs(root)))
    packaged = len(own) < ENOUGH_ROWS
    known = _complete(packaged_costs()) if packaged else own
    estimates = Estimates(root, parameters)
    tasks: dict[str, dict[str, Estimate]] = {}
    for object_id, by_stage in known.items():
        for stage, one in by_stage.items():
            seconds, size = scales(stage, parameters) if packaged else (1.0, 1.0)
            made = one.product_bytes * size if packaged else estimates.of(stage, object_id).product_bytes
            memory = int(one.memory_bytes * MEMORY_MARGIN)
            # CPU seconds stand for wall seconds: what else that machine did is no part of a plan.
            estimate = Estimate(one.cpu_s * seconds, one.cpu_s * seconds, memory, int(made), known=True)
            tasks.setdefault(object_id, {})[stage] = estimate
    return _plan(parameters.size, count, STAGES, tasks, machines, workers, times=count / len(tasks))


def machines_of(place: Place) -> Machines:
    """Return what a place offers, with this machine's size where the place does not say."""
    hosts, tasks, memory_bytes = place.capacity()
    return Machines(hosts, tasks or os.cpu_count() or 1, memory_bytes or int(MEMORY_SHARE * total_bytes()))


def side_by_side(memory_bytes: int, machines: Machines) -> int:
    """Return how many tasks that need this memory run at a time on a host; at least one."""
    return max(1, min(machines.slots, machines.memory_bytes // max(1, memory_bytes)))


def _in_memo(
    root: Path, parameters: Parameters, stage: Stage, one: Status, row: Row, verified: Verified
) -> bool:
    try:
        prepared = stage.prepare(root, parameters, one.object_id, row, verified)
    except InputError:
        return False
    folder = memo.memo_folder(root, fingerprint(prepared.parts))
    return all((folder / memo.memo_name(path)).is_file() for path in stage.targets(root, one.object_id))


def _complete(tasks: Sequence[Taken]) -> dict[str, dict[str, Taken]]:
    """Return the tasks by object and stage, of the objects that have one in every stage."""
    found: dict[str, dict[str, Taken]] = {}
    for one in tasks:
        if one.stage in STAGES:
            found.setdefault(one.object_id, {})[one.stage] = one
    return {name: by_stage for name, by_stage in found.items() if len(by_stage) == len(STAGES)}


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
    planned = {name: _stage_plan(name, tasks, counts or {}, times) for name in stages}
    chain = max((_chain_s(stages, by_stage) for by_stage in tasks.values()), default=0.0)
    every = [one for by_stage in tasks.values() for one in by_stage.values()]
    return Plan(
        datetime.now(UTC).isoformat(timespec="milliseconds"),
        size,
        objects,
        planned,
        {
            number: _wall_time(every, chain, times, number, machines)
            for number in sorted({1, machines.workers, *workers})
        },
        chain,
        machines,
        min(sum(one.product_bytes for one in planned.values()), memo.cap_bytes()),
    )


def _stage_plan(name: str, tasks: Tasks, counts: Mapping[tuple[str, str], int], times: float) -> StagePlan:
    found = [by_stage[name] for by_stage in tasks.values() if name in by_stage]
    return StagePlan(
        counts.get((name, "kept"), 0),
        counts.get((name, "restored"), 0),
        round(len(found) * times),
        sum(one.cpu_s for one in found) * times,
        max((one.memory_bytes for one in found), default=0),
        round(sum(one.product_bytes for one in found) * times),
    )


def _chain_s(stages: Mapping[str, Stage], by_stage: Mapping[str, Estimate]) -> float:
    """Return the seconds of the longest chain of tasks of one object."""
    ends: dict[str, float] = {}
    for name, stage in stages.items():
        before = max((ends.get(other, 0.0) for other in stage.follows), default=0.0)
        ends[name] = before + (by_stage[name].wall_s if name in by_stage else 0.0)
    return max(ends.values(), default=0.0)


def _wall_time(
    tasks: Sequence[Estimate], chain_s: float, times: float, workers: int, machines: Machines
) -> WallTime:
    hosts = math.ceil(workers / machines.slots)
    work = times * sum(one.wall_s for one in tasks) / workers
    bounded = times * sum(
        one.wall_s / min(workers, hosts * side_by_side(one.memory_bytes, machines)) for one in tasks
    )
    return WallTime(max(work, chain_s), max(bounded, chain_s))
