"""The time to go that a run says, against the time that it then took."""

import csv
import heapq
import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from pipeline.dataset.stages import STAGES
from pipeline.run.costs import read_costs
from pipeline.run.estimates import TYPICAL, last_costs
from pipeline.run.flow_progress import FlowProgress

RECORDED = Path(__file__).with_name("recorded_run.csv")
SCANS = Path(__file__).parents[2] / "bench" / "factory" / "known_costs.csv"
# The recorded runs are older than the stage of collision parts.
FOLLOWS = {
    stage.name: sorted(stage.follows - {"collision"})
    for stage in STAGES.values()
    if stage.name != "collision"
}
SECOND_MINUTE_S = 60
TICK_S = 10
SHORT_S = 30  # left of a run, from when on a factor of it is a few seconds

Expected = Callable[[str, str], float]  # stage and object to seconds


class Ended(NamedTuple):
    at_s: float
    stage: str
    object_id: str
    wall_s: float
    cpu_s: float


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


class Submitting:
    """Which tasks can begin, as a run finds out, and how urgent they are."""

    def __init__(self, expected: Expected) -> None:
        self._expected = expected
        self._done: set[tuple[str, str]] = set()
        self._known: set[tuple[str, str]] = set()

    def ready(self, object_id: str) -> list[tuple[str, float, float]]:
        """Return stage, expected seconds and priority of the tasks of an object that can begin now."""
        tasks = []
        for stage, before in FOLLOWS.items():
            task = stage, object_id
            if task not in self._known and all(
                (predecessor, object_id) in self._done for predecessor in before
            ):
                self._known.add(task)
                tasks.append((stage, self._expected(stage, object_id), self._chain(stage, object_id)))
        return tasks

    def ended(self, stage: str, object_id: str) -> None:
        self._done.add((stage, object_id))

    def _chain(self, stage: str, object_id: str) -> float:
        behind = [follower for follower, before in FOLLOWS.items() if stage in before]
        chains = [self._chain(follower, object_id) for follower in behind]
        return self._expected(stage, object_id) + max(chains, default=0.0)


def scheduled(
    needed: dict[tuple[str, str], float],
    expected: Expected,
    workers: int,
    cores: float = math.inf,
    other_processes: int = 0,
) -> list[Ended]:
    """Return how tasks end that share the cores with other processes.

    Workers take tasks by priority; a single one takes the shortest first.
    """
    submitting, ready, running, ended = Submitting(expected), [], {}, []
    now = 0.0

    def submit(object_id: str) -> None:
        for stage, seconds, priority in submitting.ready(object_id):
            heapq.heappush(ready, (seconds if workers == 1 else -priority, stage, object_id))

    for object_id in sorted({object_id for _, object_id in needed}):
        submit(object_id)
    while ready or running:
        while ready and len(running) < workers:
            _, stage, object_id = heapq.heappop(ready)
            running[stage, object_id] = [needed[stage, object_id], now]
        pace = min(1.0, cores / (len(running) + other_processes))
        task = min(running, key=lambda task: running[task][0])
        left_s, began_s = running.pop(task)
        now += left_s / pace
        for entry in running.values():
            entry[0] -= left_s
        ended.append(Ended(now, *task, now - began_s, needed[task]))
        submitting.ended(*task)
        submit(task[1])
    return ended


def worst_factor(run: list[Ended], expected: Expected, workers: int, share: float = 0.0) -> float:
    """Return the largest ratio of stated and true time to go, from the second minute and this share on."""
    clock = Clock()
    progress = FlowProgress(FOLLOWS, io.StringIO(), clock)
    progress._display.start = lambda: None  # nothing is to be printed
    for stage in FOLLOWS:
        for object_id in {task.object_id for task in run}:
            progress.expect(stage, object_id, expected(stage, object_id))
    end_s = max(task.at_s for task in run)
    begin_s = max(SECOND_MINUTE_S, int(share * end_s))
    # A task ends before the next one begins, whatever the rounding of their times.
    events = [(round(task.at_s, 6), 0, task) for task in run]
    events += [(round(task.at_s - task.wall_s, 6), 1, task) for task in run]
    events += [(float(at), 2, run[0]) for at in range(begin_s, int(end_s - SHORT_S), TICK_S)]
    worst, busy = 1.0, 0
    for clock.now, kind, task in sorted(events):
        if kind == 2:
            stated, true = progress.state()[0], end_s - clock.now
            worst = max(worst, stated / true, true / stated)
            continue
        busy += 1 if kind else -1
        if not kind:
            progress.settle(task.stage, task.object_id, "computed", task.wall_s)
        progress.workers(busy, workers)
    return worst


def test_the_starter_set_on_a_busy_machine() -> None:
    """A recorded run; other work took half of both cores, so tasks took twice the CPU seconds known then."""
    with RECORDED.open(newline="") as file:
        rows = list(csv.DictReader(file))
    run = [
        Ended(float(row["ended_s"]), row["stage"], row["object"], wall_s, wall_s / 2)
        for row in rows
        for wall_s in [float(row["wall_s"])]
    ]
    expected = {(row["stage"], row["object"]): float(row["expected_cpu_s"]) for row in rows}
    factor = worst_factor(run, lambda stage, name: expected[stage, name], 2)
    print(f"starter set, 2 workers: {factor:.2f}")
    assert factor <= 1.6


@pytest.mark.parametrize(("workers", "most"), [(2, 1.5), (8, 1.5), (32, 2.0), (64, 4.5)])
def test_a_hundred_scans_that_nothing_is_known_of(workers: int, most: float) -> None:
    """Every scan is expected to take the mean of all, as an object does that never ran.

    With 64 workers one scan, whose modes take six times as long as expected, decides.
    """

    def expected(stage: str, object_id: str) -> float:
        return TYPICAL[stage].cpu_s

    costs = last_costs(read_costs(SCANS))
    took = {(stage, object_id): cost.cpu_s for (object_id, stage), cost in costs.items() if stage in FOLLOWS}
    factor = worst_factor(scheduled(took, expected, workers), expected, workers)
    print(f"hundred scans, {workers} workers: {factor:.2f}")
    assert factor <= most


def test_tasks_that_all_need_twice_as_much_show_once_some_have_ended() -> None:
    needed = {(stage, f"o{index}"): 20.0 for stage in FOLLOWS for index in range(40)}
    factor = worst_factor(scheduled(needed, lambda *_: 10.0, 4), lambda *_: 10.0, 4)
    assert factor <= 1.5


@pytest.mark.parametrize("others", [0, 2, 8])
def test_two_cores_shared_with_busy_processes(others: int) -> None:
    """Seven objects like the mean, beside other work."""
    objects = ("mug", "die", "bell", "bowl", "fork", "plate", "spatula")

    def expected(stage: str, object_id: str) -> float:
        return TYPICAL[stage].cpu_s

    needed = {(stage, name): expected(stage, name) for stage in FOLLOWS for name in objects}
    # What a busy machine gives shows once tasks of some length have ended.
    factor = worst_factor(scheduled(needed, expected, 2, 2, others), expected, 2, share=0.1)
    print(f"beside {others}: {factor:.2f}")
    assert factor <= 2.5
