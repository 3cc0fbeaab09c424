"""Waits that end by a clock of the waiting processes' own, which a busy machine makes stand still.

`OwnClock` counts the seconds in which this process and those below it had a processor, or nothing to do. Time
in which they could go on but others had the processors does not count. `wait_until` waits by it.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import psutil

PATIENCE_S = 60.0
LOOK_S = 1.0  # between looks at the clock: each reads some files for every thread

Value = TypeVar("Value")


class OwnClock:
    """Seconds since it was made or set back, by the processes that are waited for.

    Linux says how long each thread ran and how long it waited for a processor; elsewhere wall time counts.
    """

    def __init__(self) -> None:
        self.set_back()

    def set_back(self) -> None:
        """Begin at 0 again."""
        self._seconds = 0.0
        self._wall_s, self._threads = time.monotonic(), scheduled_s()

    def read(self) -> float:
        """Return the seconds that have passed."""
        wall_s, threads = time.monotonic(), scheduled_s()
        ran = waited = 0.0
        for name, (ran_s, waited_s) in threads.items():
            before = self._threads.get(name, (0.0, 0.0))
            ran, waited = ran + ran_s - before[0], waited + waited_s - before[1]
        passed = wall_s - self._wall_s
        self._seconds += max(min(passed, ran), passed - waited)
        self._wall_s, self._threads = wall_s, threads
        return self._seconds


def scheduled_s() -> dict[str, tuple[float, float]]:
    """Seconds on a processor, and of waiting for one, of each thread of this process and those below."""
    own = psutil.Process()
    threads = {}
    for process in (own, *own.children(recursive=True)):
        for path in Path(f"/proc/{process.pid}/task").glob("*/schedstat"):
            try:
                ran_ns, waited_ns, _ = path.read_text().split()
            except (OSError, ValueError):
                continue  # it has ended
            threads[path.parent.name] = int(ran_ns) / 1e9, int(waited_ns) / 1e9
    return threads


def wait_until(
    condition: Callable[[], Value],
    what: str = "",
    patience_s: float = PATIENCE_S,
    pause: Callable[[float], object] = time.sleep,
) -> Value:
    """Return what `condition` returns once that is true.

    Raises
    ------
    TimeoutError
        It was not true for `patience_s` seconds of an `OwnClock`.
    """
    clock, look_s = OwnClock(), time.monotonic() + LOOK_S
    while not (value := condition()):
        if time.monotonic() > look_s:
            if clock.read() > patience_s:
                raise TimeoutError(f"{what or condition}: not within {patience_s:g} s of its processes' own")
            look_s = time.monotonic() + LOOK_S
        pause(0.02)
    return value
