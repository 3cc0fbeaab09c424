"""What a run would do and take, before it starts.

Objects are counted as `pipeline.run.status` finds them: what is current is kept, what is not but lies in the
memo is restored, the rest is computed; so is, at most, whatever waits for an input that is yet to come.
Seconds are those of `pipeline.run.forecast.estimates`; how long all takes comes from the real dispatch in
virtual time
(`pipeline.run.forecast.simulated_flow`), with seconds drawn around their estimates.
"""

import math
import os
import random
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.provenance import fingerprint
from pipeline.cluster.places import Place
from pipeline.dataset.crew import BLENDER, GPU, Slot
from pipeline.dataset.parameters import Parameters
from pipeline.dataset.stage import Row, Stage
from pipeline.dataset.stages import STAGES
from pipeline.dataset.verified import Verified
from pipeline.run.forecast.drawn_objects import drawn_objects, known_objects
from pipeline.run.forecast.estimates import ENOUGH_ROWS, MEMORY_MARGIN, Estimate, Estimates, Model, scales
from pipeline.run.forecast.known_costs import KnownCost, costs_of, packaged_costs
from pipeline.run.forecast.simulated_flow import Work, chain_s, lower_bound_s, run_flow
from pipeline.run.status import CURRENT, WAITING, Status, status
from pipeline.sandbox.host_memory import total_bytes
from pipeline.store import memo

MOST_SIMULATED = 12_000  # tasks; beyond, the lower bound stands for the makespan, which it then nears
DRAWS = 3
NORMAL_95 = 1.645  # one-sided 95 % of a normal variable
MEMORY_SHARE = 0.9  # of a host, that tasks may take

Tasks = dict[str, dict[str, Estimate]]  # to compute, by object and stage


@dataclass(frozen=True)
class Range:
    """A figure with what it may as well be."""

    low: float
    middle: float
    high: float


@dataclass(frozen=True)
class StagePlan:
    """What a stage would do.

    Parameters
    ----------
    kept, restored, computed
        Objects.
    known
        Tasks, of those to compute, that ran here before.
    cpu_s
        Seconds of all its tasks, nine in ten between low and high; that machines differ is left out.
    memory_bytes
        Largest peak of a task, on the high side.
    product_bytes
        Of the products to compute.
    """

    kept: int
    restored: int
    computed: int
    known: int
    cpu_s: Range
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
class Plan:
    """What a run would do and take.

    Parameters
    ----------
    time
        When it was made, UTC.
    size, objects
        Size of ``params.yaml`` it is for, and number of objects.
    stages
        By name.
    makespans_s
        Wall seconds by number of workers: least, middle and most of `DRAWS` draws.
    chain_s
        Expected seconds of the longest chain of tasks of one object: no number of workers is faster.
    machines
        Where ``makespans_s`` of their number of workers is for.
    memo_bytes
        What the memo grows by, at most its cap.
    """

    time: str
    size: str
    objects: int
    stages: Mapping[str, StagePlan]
    makespans_s: Mapping[int, Range]
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
        Other numbers of workers to give the makespan for.
    stages
        Each after those whose products it reads.
    """
    estimates = Estimates(root, parameters)
    verified = Verified(root)
    by_name = {stage.name: stage for stage in stages}
    counts = {name: Counter[str]() for name in by_name}
    tasks: Tasks = {}
    for one in status(root, stages, parameters, rows):
        row = rows.get(one.object_id)
        if row is None:
            continue  # no longer listed
        if one.state == CURRENT:
            counts[one.stage]["kept"] += 1
        elif one.state != WAITING and _in_memo(root, parameters, by_name[one.stage], one, row, verified):
            counts[one.stage]["restored"] += 1
        else:
            tasks.setdefault(one.object_id, {})[one.stage] = estimates.of(one.stage, one.object_id)
    expected = _Expected(by_name, tasks, {name: estimates.model(name) for name in by_name}, counts)
    return _plan(parameters.size, len(rows), expected, machines, workers)


def plan_for_count(
    root: Path, parameters: Parameters, count: int, machines: Machines, workers: Sequence[int] = ()
) -> Plan:
    """Return the plan for so many objects that do not exist yet, drawn from those known.

    These are the objects of this data set if enough of them have costs, else the packaged ones.
    """
    own = costs_of(root)
    packaged = min(Counter(cost.stage for cost in own)[stage] for stage in STAGES) < ENOUGH_ROWS
    rows = packaged_costs() if packaged else own
    drawn = drawn_objects(known_objects(rows, list(STAGES), seed=0), count, seed=0)
    estimates = Estimates(root, parameters)
    models = {stage: estimates.model(stage) for stage in STAGES}
    tasks = {
        object_id: {
            stage: _estimate(cost, scales(stage, parameters) if packaged else (1.0, 1.0), models[stage])
            for stage, cost in costs.items()
        }
        for object_id, costs in drawn.items()
    }
    sampled = len({cost.object_id for cost in rows})
    expected = _Expected(STAGES, tasks, models, {stage: Counter() for stage in STAGES}, sampled)
    return _plan(parameters.size, count, expected, machines, workers)


def machines_of(place: Place) -> Machines:
    """Return what a place offers, this machine standing for hosts of which nothing is said."""
    here = place.workers or os.cpu_count() or 1
    memory = int(place.memory_gb * 1e9) if place.memory_gb else int(MEMORY_SHARE * total_bytes())
    if place.kind == "ssh":
        return Machines(max(1, len(place.ssh.hosts)), here, memory)
    if place.kind == "slurm":
        slurm = place.slurm
        return Machines(slurm.jobs, place.workers or slurm.cores, int(MEMORY_SHARE * slurm.memory_gb * 1e9))
    if place.kind == "kubernetes":
        return Machines(place.workers or 1, 1, int(MEMORY_SHARE * place.kubernetes.memory_gb * 1e9))
    return Machines(1, here, memory)


def side_by_side(memory_bytes: int, machines: Machines) -> int:
    """Return how many tasks of so much memory run at a time on a host; a larger one runs alone."""
    return max(1, min(machines.slots, machines.memory_bytes // max(1, memory_bytes)))


@dataclass(frozen=True)
class _Expected:
    """What there is to do, and what is known of it; `sampled` objects stand for those that do not exist."""

    stages: Mapping[str, Stage]
    tasks: Tasks
    models: Mapping[str, Model | None]
    counts: Mapping[str, Counter[str]]
    sampled: int | None = None

    @property
    def follows(self) -> dict[str, frozenset[str]]:
        return {name: stage.follows for name, stage in self.stages.items()}

    def works(self, rng: random.Random | None) -> dict[str, dict[str, Work]]:
        """Return the tasks as works; the true seconds drawn, or the mean without a source of chance."""
        return {
            object_id: {
                name: Work(
                    self._true_s(name, one, rng),
                    one.wall_s,
                    one.high_wall_s,
                    one.memory_bytes,
                    self.stages[name].needs,
                )
                for name, one in works.items()
            }
            for object_id, works in self.tasks.items()
        }

    def _true_s(self, name: str, one: Estimate, rng: random.Random | None) -> float:
        model = self.models[name]
        if one.known or model is None:
            return one.wall_s
        if rng is None:
            return one.wall_s * model.mean
        return one.wall_s * math.exp(rng.gauss(0.0, math.log(model.spread) / NORMAL_95))


def _in_memo(
    root: Path, parameters: Parameters, stage: Stage, one: Status, row: Row, verified: Verified
) -> bool:
    try:
        prepared = stage.prepare(root, parameters, one.object_id, row, verified)
    except InputError:
        return False
    folder = memo.memo_folder(root, fingerprint(prepared.parts))
    return all((folder / memo.memo_name(path)).is_file() for path in stage.targets(root, one.object_id))


def _estimate(cost: KnownCost, scale: tuple[float, float], model: Model | None) -> Estimate:
    usual = model.product_bytes if model else 0
    made = usual if cost.product_bytes is None else int(cost.product_bytes * scale[1])
    seconds = cost.cpu_s * scale[0]
    # Of packaged and own costs alike CPU seconds: what else the machine did is no part of a plan.
    return Estimate(seconds, seconds, seconds, int(cost.memory_bytes * MEMORY_MARGIN), made, known=True)


def _plan(size: str, objects: int, expected: _Expected, machines: Machines, workers: Sequence[int]) -> Plan:
    stages = {name: _stage_plan(name, expected) for name in expected.stages}
    makespans = {
        number: _makespan(expected, machines, number) for number in sorted({1, machines.workers, *workers})
    }
    chain = max(
        (
            chain_s(works, expected.follows, name, true=True)
            for works in expected.works(None).values()
            for name in works
        ),
        default=0.0,
    )
    return Plan(
        datetime.now(UTC).isoformat(timespec="milliseconds"),
        size,
        objects,
        stages,
        makespans,
        chain,
        machines,
        min(sum(one.product_bytes for one in stages.values()), memo.cap_bytes()),
    )


def _stage_plan(name: str, expected: _Expected) -> StagePlan:
    model, counts = expected.models[name], expected.counts[name]
    found = [works[name] for works in expected.tasks.values() if name in works]
    known = [one for one in found if one.known]
    new = [one for one in found if not one.known]
    mean, deviation, rows = (model.mean, model.deviation, model.rows) if model else (1.0, 0.0, 1)
    unknown_s = sum(one.cpu_s for one in new)
    middle = sum(one.cpu_s for one in known) + mean * unknown_s
    # Each task strays on its own; that the model was fitted to few rows strays for all alike.
    single = deviation * math.sqrt(sum(one.cpu_s**2 for one in new))
    common = deviation / math.sqrt(rows) * unknown_s
    if expected.sampled is not None:  # they stand for others, whose mean is as sure as theirs
        single = float(np.std([one.cpu_s for one in found])) * math.sqrt(len(found))
        common = single * math.sqrt(len(found) / min(expected.sampled, rows))
    half = NORMAL_95 * math.hypot(single, common)
    return StagePlan(
        counts["kept"],
        counts["restored"],
        len(found),
        len(known),
        Range(max(0.0, middle - half), middle, middle + half),
        max((one.memory_bytes for one in found), default=0),
        sum(one.product_bytes for one in found),
    )


def _makespan(expected: _Expected, machines: Machines, workers: int) -> Range:
    """Return the wall seconds with so many workers, on hosts as `machines` has them."""
    offers = frozenset({BLENDER, GPU})
    slots = [Slot(str(place), str(place // machines.slots), offers) for place in range(workers)]
    memory = {slot.host: machines.memory_bytes for slot in slots}
    found = []
    for seed in range(DRAWS):
        works = expected.works(random.Random(seed))
        if workers == 1 or sum(map(len, works.values())) > MOST_SIMULATED:
            found.append(lower_bound_s(works, expected.follows, workers))
        else:
            found.append(run_flow(works, expected.follows, slots, memory).makespan_s)
    found.sort()
    return Range(found[0], found[len(found) // 2], found[-1])
