"""The memory of a task's processes, watched so that one that grows too large fails before its host does."""

import contextlib
import resource
import time
from collections.abc import Callable, Iterable, Sequence

from pipeline.dataset.task import Failure
from pipeline.sandbox import host_memory
from pipeline.sandbox.process_tree import descendants

LIMIT_SHARE = 0.9  # of the host's memory, where no limit is given
RESERVE_SHARE = 0.04  # of the host's memory: with less left, tasks above what was expected of them end
# A task is not ended while it stays below its estimate times this factor, or plus these bytes.
ALLOWED_FACTOR = 1.5
ALLOWED_BYTES = 256 << 20
ALLOWED_SHARE = 0.5  # of the host's memory, where nothing is expected
FASTEST_GROWTH = 8e9  # bytes per second that a thread can touch for the first time
SHORTEST_PAUSE_S, LONGEST_PAUSE_S = 0.02, 1.0
LARGEST_PART = 0.05  # of a processor's time that may go into looking; waiting on a busy host is no reason
ELAPSED_SHARE = 0.1  # of the time a task has run: short tasks are looked at often enough to know their peak


class MemoryWatch:
    """Looks at the memory of all processes below one, as often as the remaining memory requires.

    Parameters
    ----------
    pid
        The process above those to watch, itself not counted.
    limit_bytes
        What they may use together; None for `LIMIT_SHARE` of the host's memory.
    expected_bytes
        What they are expected to use at most; 0 where nothing is known.
    available
        Bytes that the host has left.
    """

    def __init__(
        self,
        pid: int,
        limit_bytes: int | None = None,
        expected_bytes: int = 0,
        available: Callable[[], int] = host_memory.available_bytes,
    ) -> None:
        total = host_memory.total_bytes()
        self._pid = pid
        self._limit = limit_bytes or int(LIMIT_SHARE * total)
        self._reserve = int(RESERVE_SHARE * total)
        self._allowed = ALLOWED_SHARE * total
        if expected_bytes:
            self._allowed = ALLOWED_FACTOR * expected_bytes + ALLOWED_BYTES
        self._available = available
        self._begin = time.monotonic()
        # Seconds until the next look; by then the fastest growth has not used up the remaining memory.
        self.pause_s = SHORTEST_PAUSE_S
        self.peak_bytes = 0

    def look(self, object_id: str) -> Failure | None:
        """Return why the processes must end, None where they need not."""
        begin_cpu_s = time.thread_time()
        pids = descendants(self._pid)
        used, available = resident_bytes(pids), self._available()
        self.peak_bytes = max(self.peak_bytes, used)
        failure = None
        if used > self._limit and (used := proportional_bytes(pids)) > self._limit:
            failure = Failure(
                object_id,
                f"used more than {_gigabytes(self._limit)}: {_gigabytes(used)} in {_processes(pids)}",
                "Lower the settings of this stage, or raise memory_limit_bytes of the place.",
            )
        elif available < self._reserve and used > self._allowed:
            failure = Failure(
                object_id,
                f"used {_gigabytes(used)} in {_processes(pids)}, more than its part, when its host had only "
                f"{_gigabytes(available)} left",
                "Run fewer workers on a host, or lower the settings of this stage.",
            )
        room = max(0, min(self._limit - used, available - self._reserve))
        pause = min(room / FASTEST_GROWTH, LONGEST_PAUSE_S, ELAPSED_SHARE * (time.monotonic() - self._begin))
        self.pause_s = max(pause, SHORTEST_PAUSE_S, (time.thread_time() - begin_cpu_s) / LARGEST_PART)
        return failure


def resident_bytes(pids: Iterable[int]) -> int:
    """Return the memory of processes, what they share counted in each of them."""
    pages = 0
    for pid in pids:
        with contextlib.suppress(OSError, IndexError, ValueError), open(f"/proc/{pid}/statm", "rb") as file:
            pages += int(file.read().split()[1])
    return pages * resource.getpagesize()


def proportional_bytes(pids: Sequence[int]) -> int:
    """Return the memory of processes, what they share counted once; slow for large ones."""
    import psutil

    total = 0
    for pid in pids:
        with contextlib.suppress(psutil.NoSuchProcess):
            total += psutil.Process(pid).memory_full_info().pss
    return total


def _gigabytes(number: int) -> str:
    return f"{number / 1e9:.3g} GB"


def _processes(pids: Sequence[int]) -> str:
    return "one process" if len(pids) == 1 else f"{len(pids)} processes"
