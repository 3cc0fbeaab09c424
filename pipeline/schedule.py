"""Which waiting job goes to which free slot."""

from collections import defaultdict
from collections.abc import Iterable, Mapping

from pipeline.crew import Job, Slot


def choose(
    waiting: Iterable[Job],
    free: Mapping[str, Slot],
    memory_left: Mapping[str, int],
    busy_hosts: frozenset[str],
) -> list[tuple[Job, str]]:
    """Return jobs to start now with their slots.

    The job with the longest chain of work behind it goes first (Graham's list scheduling by critical
    path). A job whose memory is not free anywhere holds back one host, the one with most memory left, so
    that smaller jobs do not overtake it for ever; one larger than every host runs on a host alone.

    Parameters
    ----------
    waiting
        Jobs, longest `path_seconds` first.
    free
        Free slots by name.
    memory_left
        Bytes left on each host, by host.
    busy_hosts
        Hosts on which something runs.
    """
    left = dict(memory_left)
    by_host: dict[str, list[Slot]] = defaultdict(list)
    for slot in free.values():
        by_host[slot.host].append(slot)
    busy = set(busy_hosts)
    held: set[str] = set()
    chosen: list[tuple[Job, str]] = []
    for job in waiting:
        able = [
            slot
            for host, slots in by_host.items()
            if host not in held
            for slot in slots
            if job.needs <= slot.offers
        ]
        if not able:
            if not any(slots for host, slots in by_host.items() if host not in held):
                break
            continue
        fitting = [slot for slot in able if job.memory_bytes <= left[slot.host] or slot.host not in busy]
        if not fitting:
            held.add(max(able, key=lambda slot: left[slot.host]).host)
            continue
        # Slots that offer more than is needed are left to those who need it.
        slot = min(fitting, key=lambda slot: (len(slot.offers), -left[slot.host], slot.name))
        by_host[slot.host].remove(slot)
        left[slot.host] -= job.memory_bytes
        busy.add(slot.host)
        chosen.append((job, slot.name))
    return chosen
