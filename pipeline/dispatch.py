"""Give jobs to a crew as slots become free, and hand on their outcomes."""

import bisect
from collections import Counter
from collections.abc import Iterator

from pipeline.crew import Crew, Finished, Job, Lost
from pipeline.schedule import choose
from pipeline.task import Failure, Outcome

MOST_LOSSES = 3  # slots that a job may lose before it counts as the reason


class Dispatch:
    """Jobs on their way through a crew; more may be added while it runs.

    Parameters
    ----------
    crew
        Who runs them.
    """

    def __init__(self, crew: Crew) -> None:
        self._crew = crew
        self._waiting: list[Job] = []
        self._running: dict[str, tuple[Job, str]] = {}  # by slot: the job, and the slot's host
        self._losses: Counter[str] = Counter()

    def add(self, job: Job) -> None:
        """Let a job wait for a slot, those with the longest chain behind them first."""
        bisect.insort(self._waiting, job, key=lambda job: (-job.path_seconds, job.key))

    def outcomes(self) -> Iterator[Finished]:
        """Yield what ends, until nothing waits and nothing runs.

        A job whose slot was lost is tried again elsewhere; one that lost `MOST_LOSSES` slots failed.
        """
        while self._waiting or self._running:
            self._start()
            for event in self._crew.wait():
                self._running.pop(event.slot, None)
                if isinstance(event, Finished):
                    yield event
                elif (given_up := self._after_loss(event)) is not None:
                    yield given_up

    def _start(self) -> None:
        slots = self._crew.slots()
        free = {name: slot for name, slot in slots.items() if name not in self._running}
        if not free or not self._waiting:
            return
        left = dict(self._crew.memory_bytes())
        for job, host in self._running.values():
            if host in left:
                left[host] -= job.memory_bytes
        busy = frozenset(host for _, host in self._running.values())
        for job, name in choose(self._waiting, free, left, busy):
            self._waiting.remove(job)
            self._running[name] = (job, slots[name].host)
            self._crew.start(job, name)

    def _after_loss(self, lost: Lost) -> Finished | None:
        self._losses[lost.job.key] += 1
        if self._losses[lost.job.key] < MOST_LOSSES:
            self.add(lost.job)
            return None
        object_id = lost.job.call.request.object_id
        failure = Failure(
            object_id,
            f"{MOST_LOSSES} workers were lost while they ran it ({lost.reason})",
            "Out of memory, most likely: run fewer workers, or lower the settings of this stage.",
        )
        return Finished(lost.job, lost.slot, Outcome(object_id, failure))
