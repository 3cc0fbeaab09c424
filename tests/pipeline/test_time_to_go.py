"""The time to go that a run says, against the time that it then took."""

import csv
import heapq
import io
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.stages import STAGES
from pipeline.run.flow_progress import FlowProgress
from pipeline.run.forecast.estimates import Estimates, fit, packaged_costs

REPOSITORY = Path(__file__).parents[2]
RECORDED = Path(__file__).with_name("recorded_run.csv")
# The recorded runs are older than the stage of collision parts.
FOLLOWS = {stage.name: sorted(stage.follows) for stage in STAGES.values() if stage.name != "collision"}
SECOND_MINUTE_S = 60
TICK_S = 10
SHORT_S = 30  # left of a run, from when on a factor of it is a few seconds

# Stage, object, and whether its mesh was measured, to expected seconds.
Expected = Callable[[str, str, bool], float]


class Ended(NamedTuple):
    at_s: float
    stage: str
    object_id: str
    wall_s: float


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
        found = []
        for stage, before in FOLLOWS.items():
            task = stage, object_id
            if task not in self._known and all((other, object_id) in self._done for other in before):
                self._known.add(task)
                measured = stage != "objects"
                seconds = self._expected(stage, object_id, measured)
                found.append((stage, seconds, self._chain(stage, object_id, measured)))
        return found

    def ended(self, stage: str, object_id: str) -> None:
        self._done.add((stage, object_id))

    def _chain(self, stage: str, object_id: str, measured: bool) -> float:
        behind = [other for other, before in FOLLOWS.items() if stage in before]
        chains = [self._chain(other, object_id, measured) for other in behind]
        return self._expected(stage, object_id, measured) + max(chains, default=0.0)


def scheduled(took: dict[tuple[str, str], float], expected: Expected, workers: int) -> list[Ended]:
    """Return how tasks end that workers take by priority."""
    submitting, ready, running, ended = Submitting(expected), [], [], []
    now = 0.0

    def submit(object_id: str) -> None:
        for stage, _, priority in submitting.ready(object_id):
            heapq.heappush(ready, (-priority, stage, object_id))

    for object_id in sorted({object_id for _, object_id in took}):
        submit(object_id)
    while ready or running:
        while ready and len(running) < workers:
            _, stage, object_id = heapq.heappop(ready)
            heapq.heappush(running, (now + took[stage, object_id], stage, object_id))
        now, stage, object_id = heapq.heappop(running)
        ended.append(Ended(now, stage, object_id, took[stage, object_id]))
        submitting.ended(stage, object_id)
        submit(object_id)
    return ended


def worst_factor(run: list[Ended], expected: Expected, workers: int) -> float:
    """Return the largest ratio of said and true time to go, from the second minute on."""
    clock = Clock()
    progress = FlowProgress(FOLLOWS, io.StringIO(), clock)
    progress._thread = type("Shown", (), {"ident": 1})()  # nothing is to be printed
    submitting = Submitting(expected)
    objects = sorted({one.object_id for one in run})
    for stage in FOLLOWS:
        for object_id in objects:
            progress.expect(stage, object_id, expected(stage, object_id, False))
    for object_id in objects:
        for stage, seconds, priority in submitting.ready(object_id):
            progress.submit(stage, object_id, seconds, priority)
    end_s = max(one.at_s for one in run)
    events = [(one.at_s, 0, one) for one in run] + [(one.at_s - one.wall_s, 1, one) for one in run]
    events += [(float(at), 2, run[0]) for at in range(SECOND_MINUTE_S, int(end_s - SHORT_S), TICK_S)]
    busy, worst = 0, 1.0
    for clock.now, kind, one in sorted(events):
        if kind == 2:
            said, true = progress.seconds_to_go(), end_s - clock.now
            worst = max(worst, said / true, true / said)
            continue
        busy += 1 if kind else -1
        if not kind:
            progress.settle(one.stage, one.object_id, "computed", one.wall_s)
            submitting.ended(one.stage, one.object_id)
            for stage, seconds, priority in submitting.ready(one.object_id):
                progress.submit(stage, one.object_id, seconds, priority)
        progress.workers(busy, workers)
    return worst


def test_the_starter_set_on_a_busy_machine(tmp_path: Path) -> None:
    """A recorded run; other work took half of both cores, so tasks took twice the packaged CPU seconds."""
    with RECORDED.open(newline="") as file:
        run = [
            Ended(float(row["ended_s"]), row["stage"], row["object"], float(row["wall_s"]))
            for row in csv.DictReader(file)
        ]
    estimates = Estimates(tmp_path, read_parameters(REPOSITORY / "params.yaml"))
    factor = worst_factor(run, lambda stage, name, _: estimates.of(stage, name).wall_s, 2)
    print(f"starter set, 2 workers: {factor:.2f}")
    assert factor <= 1.5


@pytest.mark.parametrize(("workers", "most"), [(2, 1.5), (8, 1.5), (32, 1.5), (64, 1.8)])
def test_a_hundred_scans_that_nothing_is_known_of(workers: int, most: float) -> None:
    """Every scan is estimated by the model of all, as an object is that never ran.

    With 64 workers one scan, whose modes take six times as long as expected, decides.
    """
    costs = packaged_costs()
    models = {
        stage: fit([one for (_, made_by), one in costs.items() if made_by == stage]) for stage in FOLLOWS
    }

    def expected(stage: str, object_id: str, measured: bool) -> float:
        return models[stage].at(costs[object_id, stage].load if measured else None).wall_s

    took = {(stage, object_id): one.wall_s for (object_id, stage), one in costs.items() if stage in FOLLOWS}
    factor = worst_factor(scheduled(took, expected, workers), expected, workers)
    print(f"hundred scans, {workers} workers: {factor:.2f}")
    assert factor <= most


def test_tasks_that_all_take_twice_as_long_show_once_some_have_ended() -> None:
    took = {(stage, f"o{index}"): 20.0 for stage in FOLLOWS for index in range(40)}
    factor = worst_factor(scheduled(took, lambda *_: 10.0, 4), lambda *_: 10.0, 4)
    assert factor <= 1.5
