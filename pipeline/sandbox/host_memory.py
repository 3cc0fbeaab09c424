"""Memory of this host, or of the control group that holds this process where that is smaller."""

import contextlib
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

UNLIMITED = 1 << 60  # version 1 of control groups writes a number near 2**63 where there is no limit


class _Group(NamedTuple):
    """Files of a control group."""

    limit: Path
    used: Path
    statistics: Path
    events: Path
    reclaimable: str  # line of the statistics: cache that goes when memory is asked for


# By the controllers that /proc/self/cgroup names, of version 2, which names none, and of version 1: where the
# groups are mounted, the files of limit, use and events, and the reclaimable line.
LAYOUTS = {
    "": ("", "max", "current", "events", "inactive_file"),
    "memory": ("memory", "limit_in_bytes", "usage_in_bytes", "oom_control", "total_inactive_file"),
}


def total_bytes() -> int:
    """Return the bytes that processes here may use together."""
    import psutil

    limits = [limit for group in _groups() if (limit := _number(group.limit)) is not None]
    return min([int(psutil.virtual_memory().total), *limits])


def available_bytes() -> int:
    """Return the bytes that can still be taken before the host swaps or kills."""
    import psutil

    room = [int(psutil.virtual_memory().available)]
    for group in _groups():
        limit, used = _number(group.limit), _number(group.used)
        if limit is not None and used is not None:
            room.append(max(0, limit - used + _entry(group.statistics, group.reclaimable)))
    return min(room)


def out_of_memory_kills() -> int:
    """Return how often the kernel killed a process of this process's own control group for want of memory.

    A group counts its own that die, be it the group or the whole host that runs out. What dies elsewhere on
    the host says nothing of a task here, so its count is not asked: 0 where no group counts.
    """
    groups = (group for group in _all_groups() if group.events.is_file())
    return next((_entry(group.events, "oom_kill") for group in groups), 0)


@functools.cache
def _groups() -> tuple[_Group, ...]:
    """Return the limited control groups that this process is in, from its own to the outermost."""
    return tuple(group for group in _all_groups() if (_number(group.limit) or UNLIMITED) < UNLIMITED)


def _all_groups() -> Iterator[_Group]:
    try:
        lines = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, own = line.split(":", 2)
        for controller in LAYOUTS.keys() & controllers.split(","):
            where, *files, reclaimable = LAYOUTS[controller]
            mount = Path("/sys/fs/cgroup", where)
            folder = mount / own.lstrip("/")
            # In a container the own group is often mounted as the root, whatever its name outside.
            for at in (folder, *folder.parents):
                limit, used, events, statistics = (at / f"memory.{name}" for name in (*files, "stat"))
                if at.is_relative_to(mount) and limit.is_file():
                    yield _Group(limit, used, statistics, events, reclaimable)


def _number(path: Path) -> int | None:
    """Return the number in a file; None for ``max`` or no file."""
    try:
        return int(path.read_text())
    except (OSError, ValueError):
        return None


def _entry(path: Path, name: str) -> int:
    """Return the number of a line ``name number``; 0 without that line or file."""
    with contextlib.suppress(OSError):
        lines = (line.split() for line in path.read_text().splitlines())
        return next((int(line[1]) for line in lines if line[0] == name), 0)
    return 0
