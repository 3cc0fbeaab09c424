"""Which waiting job goes to which free slot."""

import heapq
from collections import defaultdict
from collections.abc import Mapping, Sequence

from pipeline.dataset.crew import Job, Slot

Needs = frozenset[str]

MOST_PASSED = 1000  # jobs without a place that others behind them may pass, so that looking stays cheap


def order(job: Job) -> tuple[float, str]:
    """Return what waiting jobs are sorted by: those with the longest chain behind them come first."""
    return (-job.path_seconds, job.key)


def choose(
    waiting: Mapping[Needs, Sequence[Job]],
    slots: Mapping[str, Slot],
    running: Mapping[str, tuple[Job, Slot]],
    memory: Mapping[str, int],
) -> list[tuple[Job, str]]:
    """Return jobs to start now with their slots.

    The job with the longest chain of work behind it goes first (Graham's list scheduling by critical
    path). A job goes to a host that has its memory, or alone to the largest there is for it if none has. If
    that is taken at the moment, it holds back one such host, the one with most memory left, so that smaller
    jobs do not overtake it for ever.

    Parameters
    ----------
    waiting
        Jobs by what they need, each in `order`.
    slots
        All slots by name.
    running
        Job and slot by name of the slots that are not free.
    memory
        Bytes of each host, by host.
    """
    left = dict(memory)
    busy = set()
    for job, slot in running.values():
        left[slot.host] = left.get(slot.host, 0) - job.memory_bytes
        busy.add(slot.host)
    free: dict[tuple[str, Needs], list[str]] = defaultdict(list)  # by host and offers
    for name in sorted(slots.keys() - running.keys(), reverse=True):
        free[slots[name].host, slots[name].offers].append(name)
    largest = {
        needs: max((memory.get(slot.host, 0) for slot in slots.values() if needs <= slot.offers), default=0)
        for needs in waiting
    }
    heads = [
        (order(jobs[0]), number, needs, 0) for number, (needs, jobs) in enumerate(waiting.items()) if jobs
    ]
    heapq.heapify(heads)
    chosen: list[tuple[Job, str]] = []
    passed = 0
    while heads and free and passed < MOST_PASSED:
        _, number, needs, place = heapq.heappop(heads)
        able = [kind for kind in free if needs <= kind[1]]
        if not able:
            continue  # nor is there a slot for any behind it that need the same
        jobs = waiting[needs]
        job = jobs[place]
        if place + 1 < len(jobs):
            heapq.heappush(heads, (order(jobs[place + 1]), number, needs, place + 1))
        large = [kind for kind in able if memory.get(kind[0], 0) >= min(job.memory_bytes, largest[needs])]
        fitting = [kind for kind in large if job.memory_bytes <= left.get(kind[0], 0) or kind[0] not in busy]
        if not fitting:
            passed += 1
            if large:
                held = max(large, key=lambda kind: left.get(kind[0], 0))[0]
                for kind in [kind for kind in free if kind[0] == held]:
                    del free[kind]
            continue
        # Slots that offer more than is needed are left to those who need it.
        host, offers = min(fitting, key=lambda kind: (len(kind[1]), -left.get(kind[0], 0), kind[0]))
        chosen.append((job, free[host, offers].pop()))
        if not free[host, offers]:
            del free[host, offers]
        left[host] = left.get(host, 0) - job.memory_bytes
        busy.add(host)
    return chosen
