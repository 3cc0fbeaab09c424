"""Give jobs to a crew as slots become free, and hand on their outcomes."""

import bisect
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from pipeline.dataset.crew import Crew, Finished, Job, Lost, Slot
from pipeline.dataset.task import Failure, Outcome
from pipeline.run.schedule import Needs, choose, order

MOST_DEATHS = 2  # of its own process, after which a job counts as the reason
MOST_LOSSES = 10  # of any kind: a body cannot kill its worker, but nothing is tried for ever


class Dispatch:
    """Jobs on their way through a crew; more may be added while it runs.

    Parameters
    ----------
    crew
        Who runs them.
    stands
        Whether the products of a job are there: a slot may be lost between making them and saying so.
    on_started
        Told how many slots are busy, and how many there are, whenever jobs were given out.
    """

    def __init__(
        self,
        crew: Crew,
        stands: Callable[[Job], bool] = lambda job: False,
        on_started: Callable[[int, int], None] = lambda busy, slots: None,
    ) -> None:
        self._crew = crew
        self._stands = stands
        self._on_started = on_started
        self._waiting: dict[Needs, list[Job]] = defaultdict(list)  # each in `order`; none empty
        self._running: dict[str, tuple[Job, Slot]] = {}  # by slot
        self._tries: Counter[str] = Counter()
        self._losses: Counter[str] = Counter()
        self._deaths: Counter[str] = Counter()

    def add(self, job: Job) -> None:
        """Let a job wait for a slot, those with the longest chain behind them first."""
        bisect.insort(self._waiting[job.needs], job, key=order)

    def events(self) -> Iterator[Finished | Lost]:
        """Yield what ends and what is lost, until nothing waits and nothing runs.

        A job whose slot or process was lost is tried again. It fails when its own process was killed
        `MOST_DEATHS` times, when it was lost `MOST_LOSSES` times in all, and when no slot can run it.
        """
        while self._waiting or self._running:
            slots = self._crew.slots()
            self._start(slots)
            self._on_started(len(self._running), len(slots))
            if self._waiting and slots and not self._running:
                yield from self._refuse(slots)
                if not self._waiting:
                    continue
            for event in self._crew.wait():
                _, slot = self._running.pop(event.slot, (None, None))
                if isinstance(event, Lost):
                    yield event
                    ended = self._after_loss(event)
                else:
                    ended = event
                if ended is not None:
                    host = slot.host if slot else ""
                    yield replace(ended, host=host, tries=self._tries.pop(ended.job.key, 1))

    def _start(self, slots: Mapping[str, Slot]) -> None:
        if not self._waiting or slots.keys() <= self._running.keys():
            return
        for job, name in choose(self._waiting, slots, self._running, self._crew.memory_bytes()):
            self._take(job)
            self._running[name] = (job, slots[name])
            self._tries[job.key] += 1
            self._crew.start(job, name)

    def _take(self, job: Job) -> None:
        jobs = self._waiting[job.needs]
        del jobs[bisect.bisect_left(jobs, order(job), key=order)]
        if not jobs:
            del self._waiting[job.needs]

    def _refuse(self, slots: Mapping[str, Slot]) -> Iterator[Finished]:
        """End the jobs that need what no slot offers or is to offer."""
        offers = frozenset().union(*(slot.offers for slot in slots.values()))
        hopeless = [needs for needs in self._waiting if not self._crew.may_still_offer(needs)]
        refused = [job for needs in hopeless for job in self._waiting.pop(needs)]
        for job in refused:
            missing = ", ".join(sorted(job.needs - offers)) or "all it needs in one place"
            remedy = "Add workers that do (the place in cluster/ says what they offer)."
            yield _failed(job, "", f"no worker offers {missing}", remedy)

    def _after_loss(self, lost: Lost) -> Finished | None:
        if self._stands(lost.job):
            call = lost.job.call
            return Finished(
                lost.job, lost.slot, Outcome(call.request.object_id, fingerprint=call.fingerprint)
            )
        key = lost.job.key
        self._losses[key] += 1
        self._deaths[key] += lost.counts
        remedy = "Out of memory, most likely: run fewer workers, or lower the settings of this stage."
        if self._deaths[key] >= MOST_DEATHS:
            return _failed(lost.job, lost.slot, f"{lost.reason}, {MOST_DEATHS} times", remedy)
        if self._losses[key] >= MOST_LOSSES:
            return _failed(lost.job, lost.slot, f"lost {MOST_LOSSES} times, at last: {lost.reason}", remedy)
        if lost.counts:
            # Memory is the likeliest reason: the second time it gets all of a host.
            whole = max(self._crew.memory_bytes().values(), default=0)
            self.add(replace(lost.job, memory_bytes=max(lost.job.memory_bytes, whole)))
        else:
            self.add(lost.job)
        return None


def _failed(job: Job, slot: str, error: str, remedy: str) -> Finished:
    object_id = job.call.request.object_id
    return Finished(job, slot, Outcome(object_id, Failure(object_id, error, remedy)))
