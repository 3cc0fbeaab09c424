"""Progress of running stages: one bar on a terminal, a line now and then in a log."""

import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, TextIO

from pipeline.run.display import Display
from pipeline.run.time_to_go import CpuClock, TimeToGo

if TYPE_CHECKING:
    from rich.console import Group


class FlowProgress:
    """CPU seconds done and left of several stages, objects settled in each, busy workers and time to go.

    Parameters
    ----------
    stages
        Each with those that it waits for.
    stream
        Where to (default: standard error).
    clock
        Wall seconds.
    """

    def __init__(
        self,
        stages: Mapping[str, Sequence[str]],
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._stream = stream or sys.stderr
        self._outcomes: dict[str, Counter[str]] = {stage: Counter() for stage in stages}
        self._cpu = CpuClock(clock)
        self._tasks = TimeToGo(stages, self._cpu)
        self._busy, self._total = 0, 1
        self._lock = threading.Lock()
        self._display = Display(self.line, self._bar, self._stream)

    def expect(self, stage: str, object_id: str, cpu_s: float) -> None:
        """Count an object as left in a stage; its task is expected to need `cpu_s`."""
        with self._lock:
            self._tasks.expect(stage, object_id, cpu_s)

    def measure(self, used: Callable[[], float | None]) -> None:
        """Take the CPU seconds that tasks used so far from `used`; None where they run on other machines."""
        with self._lock:
            self._cpu.measure(used)

    def submit(self, stage: str, object_id: str, cpu_s: float, priority: float) -> None:
        """Note that a task can begin, which is now expected to need `cpu_s`."""
        with self._lock:
            self._tasks.submit(stage, object_id, cpu_s, priority)

    def settle(
        self, stage: str, object_id: str, outcome: str, cpu_s: float = 0.0, wall_s: float = 0.0
    ) -> None:
        """Count the outcome of an object in a stage, and what its task used, 0 where none ran."""
        with self._lock:
            self._outcomes[stage][outcome] += 1
            self._cpu.tick()
            self._tasks.settle(stage, object_id, cpu_s, wall_s)

    def workers(self, busy: int, total: int) -> None:
        """Note how many workers there are and how many are busy; the first call begins to show."""
        with self._lock:
            self._busy, self._total = busy, total
            self._cpu.tick(busy)
            self._tasks.run(busy)
            left = sum(map(self._tasks.count, self._outcomes))
        if left:
            self._display.start()

    def close(self) -> None:
        """Stop, and write the outcomes of each stage on a line."""
        self._display.stop()
        for stage, counts in self._outcomes.items():
            print(f"{stage}: {_words(counts)}", file=self._stream, flush=True)

    def seconds_to_go(self) -> float:
        """Return the wall seconds that the run is expected to take yet."""
        return self._state()[0]

    def line(self) -> str:
        """Return the state in one line."""
        return " | ".join([self._status(*self._state()), *self._shares()])

    def _state(self) -> tuple[float, float, float]:
        with self._lock:
            self._cpu.tick()
            return self._tasks.seconds(self._total)

    def _status(self, to_go_s: float, left_s: float, done_s: float) -> str:
        share = done_s / ((left_s + done_s) or 1.0)
        return f"{share:.0%}, {duration(to_go_s)} to go, {self._busy} of {self._total} workers busy"

    def _shares(self) -> list[str]:
        counts = ((stage, outcomes.total()) for stage, outcomes in self._outcomes.items())
        return [f"{stage} {done}/{done + self._tasks.count(stage)}" for stage, done in counts]

    def _bar(self) -> "Group":
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table

        state = self._state()
        bar = Table.grid(padding=(0, 2))
        bar.add_row(ProgressBar(state[1] + state[2], state[2], width=24), self._status(*state))
        return Group(bar, " | ".join(self._shares()))


def duration(seconds: float) -> str:
    """Return seconds in the unit that suits them."""
    seconds = max(0.0, seconds)
    for size, unit, least in ((1, "s", 0), (60, "min", 10), (3600, "h", 100)):
        if seconds < 100 * size:
            decimals = 1 if seconds < least * size else 0
            return f"{seconds / size:.{decimals}f} {unit}"
    return f"{seconds / 86400:.1f} days"


def _words(counts: Counter[str]) -> str:
    return ", ".join(f"{number} {outcome}" for outcome, number in sorted(counts.items())) or "no object"
