"""A crew in virtual time: slots, hosts, memory, pools, workers that join late and workers that are lost."""

import heapq
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.dataset.crew import Finished, Job, Lost, Slot
from pipeline.dataset.task import Call, Outcome, Request

_ENDS, _GOES, _COMES = range(3)  # what happens to a slot, in this order at equal times


@dataclass(frozen=True)
class Absence:
    """A slot that is not there from one time to another, seconds; what it ran is lost."""

    slot: str
    begin_s: float
    end_s: float = float("inf")


@dataclass(frozen=True)
class Run:
    """A job that held a slot from one time to another, seconds."""

    job: Job
    slot: str
    begin_s: float
    end_s: float
    lost: bool = False


class SimulatedCrew:
    """Slots that take virtual time for their jobs.

    Parameters
    ----------
    slots
        All slots there ever are.
    memory_bytes
        Of each host; unbounded for a host that is not named.
    seconds
        True seconds of a job, which its estimate need not be.
    absences
        When slots are away: late joiners, losses of workers.
    overhead_s
        Seconds between jobs of a slot, for what a scheduler takes.
    """

    def __init__(
        self,
        slots: Iterable[Slot],
        memory_bytes: Mapping[str, int] | None = None,
        seconds: Callable[[Job], float] = lambda job: job.seconds,
        absences: Iterable[Absence] = (),
        overhead_s: float = 0.0,
    ) -> None:
        every = {slot.name: slot for slot in slots}
        self._every = every
        self._memory = {slot.host: 1 << 62 for slot in every.values()} | dict(memory_bytes or {})
        self._seconds = seconds
        self._overhead_s = overhead_s
        self._here = dict(every)
        self._running: dict[str, tuple[Job, float, int]] = {}  # by slot, with its begin and a serial number
        self._serial = 0
        # Time, what happens, serial number of the job that ends, slot.
        self._events: list[tuple[float, int, int, str]] = []
        for absence in absences:
            heapq.heappush(self._events, (absence.begin_s, _GOES, 0, absence.slot))
            if absence.end_s < float("inf"):
                heapq.heappush(self._events, (absence.end_s, _COMES, 0, absence.slot))
        self.now_s = 0.0
        self.runs: list[Run] = []
        while self._events and self._events[0][0] <= 0:
            self._happen(*heapq.heappop(self._events))

    def slots(self) -> Mapping[str, Slot]:
        """Return the slots that are there now."""
        return self._here

    def memory_bytes(self) -> Mapping[str, int]:
        """Return the memory of each host."""
        return self._memory

    def may_still_offer(self, needs: frozenset[str]) -> bool:
        """Whether a slot that is away now and offers `needs` will come."""
        return any(kind == _COMES and needs <= self._every[slot].offers for _, kind, _, slot in self._events)

    def start(self, job: Job, slot: str) -> None:
        """Begin a job.

        Raises
        ------
        ValueError
            The slot runs another job or is not there: a defect of whoever chose it.
        """
        if slot in self._running or slot not in self._here:
            raise ValueError(f"{slot} is not free")
        self._serial += 1
        self._running[slot] = (job, self.now_s, self._serial)
        end = self.now_s + self._overhead_s + self._seconds(job)
        heapq.heappush(self._events, (end, _ENDS, self._serial, slot))

    def wait(self) -> Sequence[Finished | Lost]:
        """Let time pass until something happens; return what ended at that time.

        Raises
        ------
        ValueError
            Nothing will ever happen.
        """
        if not self._events:
            raise ValueError("nothing runs and nothing is to come")
        time = self._events[0][0]
        ended: list[Finished | Lost] = []
        while self._events and self._events[0][0] == time:
            happened = self._happen(*heapq.heappop(self._events))
            if happened is not None:
                ended.append(happened)
        return ended

    def _happen(self, time: float, kind: int, serial: int, slot: str) -> Finished | Lost | None:
        running = self._running.get(slot)
        if kind == _ENDS:
            if running is None or running[2] != serial:
                return None  # it was lost before its end
            self.now_s = time
            return self._end(slot, lost=False)
        self.now_s = max(self.now_s, time)
        if kind == _COMES:
            self._here[slot] = self._every[slot]
            return None
        self._here.pop(slot, None)
        return self._end(slot, lost=True) if running is not None else None

    def _end(self, slot: str, lost: bool) -> Finished | Lost:
        job, begin, _ = self._running.pop(slot)
        self.runs.append(Run(job, slot, begin, self.now_s, lost))
        if lost:
            return Lost(job, slot, "the worker was lost", counts=False)
        return Finished(job, slot, Outcome(job.call.request.object_id, None))


def hosts(count: int, slots: int, offers: Iterable[str] = ()) -> list[Slot]:
    """Return the slots of so many hosts with so many slots each."""
    pools = frozenset(offers)
    return [
        Slot(f"host{host}:{place}", f"host{host}", pools) for host in range(count) for place in range(slots)
    ]


def call_of(stage: str, object_id: str) -> Call:
    """Return a call that stands for a task without one."""
    return Call(stage, "", Request(object_id, {}, {}, {}, 0), (), "", {}, Path())
