"""What a run over all objects and stages would take: the real dispatch, a crew in virtual time, no work."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.dataset.crew import Job, Lost, Slot
from pipeline.run.dispatch import Dispatch
from pipeline.run.forecast.simulation import Absence, Run, SimulatedCrew, call_of


@dataclass(frozen=True)
class Work:
    """One task of an object, as it is expected and as it truly is.

    Parameters
    ----------
    true_s, expected_s
        Seconds.
    high_s
        Seconds that few tasks like it exceed: what the order of jobs goes by.
    memory_bytes
        Expected peak.
    needs
        What its slot must offer.
    """

    true_s: float
    expected_s: float
    high_s: float
    memory_bytes: int = 0
    needs: frozenset[str] = frozenset()


Follows = Mapping[str, frozenset[str]]  # stage to the stages whose products it reads, each after those


@dataclass(frozen=True)
class Timeline:
    """How a simulated run went."""

    makespan_s: float
    runs: Sequence[Run]


def run_flow(
    objects: Mapping[str, Mapping[str, Work]],
    follows: Follows,
    slots: Sequence[Slot],
    memory_bytes: Mapping[str, int] | None = None,
    absences: Iterable[Absence] = (),
    overhead_s: float = 0.0,
    in_listed_order: bool = False,
) -> Timeline:
    """Return how the tasks of all objects would run, each as soon as those it follows are done.

    Parameters
    ----------
    objects
        Tasks by object and stage; stages that are settled are left out.
    follows
        The stages in order.
    slots, memory_bytes, absences, overhead_s
        Of the crew.
    in_listed_order
        Objects first come first served, instead of the longest chain first.
    """
    ranks = {object_id: rank for rank, object_id in enumerate(objects)}
    crew = SimulatedCrew(
        slots,
        memory_bytes,
        lambda job: objects[job.call.request.object_id][job.call.stage].true_s,
        absences,
        overhead_s,
    )
    dispatch = Dispatch(crew)
    done: dict[str, set[str]] = {object_id: set() for object_id in objects}

    def add(object_id: str, stage: str) -> None:
        work = objects[object_id][stage]
        path = (
            chain_s(objects[object_id], follows, stage) if not in_listed_order else -float(ranks[object_id])
        )
        dispatch.add(Job(call_of(stage, object_id), work.expected_s, path, work.memory_bytes, work.needs))

    for object_id, works in objects.items():
        for stage in works:
            if not follows[stage] & works.keys():
                add(object_id, stage)
    for event in dispatch.events():
        if isinstance(event, Lost):
            continue
        object_id, ended = event.job.call.request.object_id, event.job.call.stage
        finished_stages = done[object_id]
        finished_stages.add(ended)
        works = objects[object_id]
        for stage in works:
            if ended in follows[stage] and follows[stage] & works.keys() <= finished_stages:
                add(object_id, stage)
    return Timeline(crew.now_s, crew.runs)


def run_stage_by_stage(
    objects: Mapping[str, Mapping[str, Work]], follows: Follows, slots: Sequence[Slot], **settings: Any
) -> Timeline:
    """Return how the tasks would run with each stage waiting for all of the one before."""
    makespan = 0.0
    runs: list[Run] = []
    for stage in follows:
        part = {name: {stage: works[stage]} for name, works in objects.items() if stage in works}
        if part:
            timeline = run_flow(part, {stage: frozenset()}, slots, **settings)
            makespan += timeline.makespan_s
            runs += timeline.runs
    return Timeline(makespan, runs)


def chain_s(works: Mapping[str, Work], follows: Follows, stage: str, true: bool = False) -> float:
    """Return the high seconds (or the true ones) of a task and of the longest chain of tasks behind it."""
    own = works[stage].true_s if true else works[stage].high_s
    behind = (other for other in works if stage in follows[other])
    return own + max((chain_s(works, follows, other, true) for other in behind), default=0.0)


def lower_bound_s(objects: Mapping[str, Mapping[str, Work]], follows: Follows, slots: int) -> float:
    """Return what no schedule can beat: all work shared evenly, or the longest chain of one object."""
    total = sum(work.true_s for works in objects.values() for work in works.values())
    longest = max(
        (chain_s(works, follows, stage, true=True) for works in objects.values() for stage in works),
        default=0.0,
    )
    return max(total / slots, longest)
