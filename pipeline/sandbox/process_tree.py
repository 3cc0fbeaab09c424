"""The processes that a process started, and what those started."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

LISTED = Path("/proc/thread-self/children").exists()  # as by Linux, unless it is built without it


def descendants(pid: int) -> list[int]:
    """Return the ids of all processes below `pid`, without itself; of none that is gone."""
    pids: list[int] = []
    pending = [pid]
    while pending:
        below = list(_children(pending.pop()))
        pids.extend(below)
        pending.extend(below)
    return pids


def end_with_variable(name: str, value: str) -> None:
    """Kill every process that was started with an environment variable of this value, and what it starts.

    Unlike `descendants` this finds those whose parents are gone; it looks at every process of the host.
    """
    import psutil

    unfinished = True
    while unfinished:
        unfinished = False
        # psutil keeps processes by number, and refuses to end one that has taken the number of another.
        psutil.process_iter.cache_clear()
        for process in psutil.process_iter(["environ"]):
            environment = process.info["environ"] or {}  # of another user's process, nothing is known
            if environment.get(name) == value and process.pid != os.getpid():
                with contextlib.suppress(psutil.Error):
                    process.kill()
                    process.wait(1.0)
                    unfinished = True


def _children(pid: int) -> Iterator[int]:
    """Yield the children of a process; Linux lists them by the thread that started them."""
    if not LISTED:
        import psutil

        with contextlib.suppress(psutil.Error):
            yield from (child.pid for child in psutil.Process(pid).children())
        return
    tasks = f"/proc/{pid}/task"
    with contextlib.suppress(OSError):
        for thread in os.listdir(tasks):
            with open(f"{tasks}/{thread}/children", "rb") as file:
                yield from map(int, file.read().split())
