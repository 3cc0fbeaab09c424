"""Progress of running stages: bars on a terminal, a line now and then in a log."""

import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TextIO

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

LOG_INTERVAL_S = 30.0


class FlowProgress:
    """Objects settled and left in each of several stages, busy workers and time to go.

    Each stage stands with those that it waits for.
    """

    def __init__(
        self,
        stages: Mapping[str, Sequence[str]],
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._stages, self._stream, self._clock = stages, stream or sys.stderr, clock
        self._outcomes: dict[str, Counter[str]] = {stage: Counter() for stage in stages}
        self._left: dict[str, dict[str, float]] = {stage: {} for stage in stages}  # object to seconds
        self._expected, self._took = dict.fromkeys(stages, 0.0), dict.fromkeys(stages, 0.0)  # ended tasks
        self._earliest: dict[str, float] = {}  # object to the time before which it cannot be ready
        self._busy, self._total = 0, 1
        self._spent, self._spent_at = 0.0, clock()  # worker seconds on tasks that have not ended, and when
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)

    def expect(self, stage: str, object_id: str, seconds: float) -> None:
        """Count an object as left in a stage; its task is expected to take `seconds`."""
        with self._lock:
            self._left[stage][object_id] = seconds
            self._earliest[object_id] = self._clock() + self._chain(object_id)

    def settle(self, stage: str, object_id: str, outcome: str, seconds: float = 0.0) -> None:
        """Count the outcome of an object in a stage; its task took `seconds`, 0 where none ran."""
        with self._lock:
            self._outcomes[stage][outcome] += 1
            expected = self._left[stage].pop(object_id, 0.0)
            if seconds > 0:
                self._spent = max(0.0, self._spent_now() - seconds)
                self._expected[stage] += expected
                self._took[stage] += seconds
            self._earliest[object_id] = self._clock() + self._chain(object_id)

    def workers(self, busy: int, total: int) -> None:
        """Note how many workers there are and how many are busy; the first call begins to show."""
        with self._lock:
            self._spent_now()
            self._busy, self._total = busy, total
        if not self._thread.ident and any(self._left.values()):
            self._thread.start()

    def close(self) -> None:
        """Stop, and write the outcomes of each stage on a line."""
        self._closed.set()
        if self._thread.ident:
            self._thread.join()
        for stage, counts in self._outcomes.items():
            print(f"{stage}: {_words(counts)}", file=self._stream, flush=True)

    def seconds_to_go(self) -> float:
        """Return work left over workers, or the longest chain of one object: no schedule is faster."""
        with self._lock:
            work = sum(self._pace(stage) * sum(left.values()) for stage, left in self._left.items())
            work -= self._spent_now()
            chain = max(self._earliest.values(), default=0.0) - self._clock()
        return max(0.0, work / max(1, self._total), chain)

    def line(self) -> str:
        """Return the state in one line."""
        return " | ".join(
            [self._status(), *(f"{stage} {done}/{total}" for stage, done, total in self._counts())]
        )

    def _show(self) -> None:
        console = Console(file=self._stream, force_terminal=self._stream.isatty(), highlight=False)
        while not console.is_interactive:
            print(self.line(), file=self._stream, flush=True)
            if self._closed.wait(LOG_INTERVAL_S):
                return
        screen = sys.stdout.isatty()  # output to a file must not appear on the terminal
        with Live(get_renderable=self._bars, console=console, transient=True, redirect_stdout=screen):
            self._closed.wait()

    def _bars(self) -> Group:
        bars = Table.grid(padding=(0, 2))
        for stage, done, total in self._counts():
            words = _words(self._outcomes[stage])
            bars.add_row(stage, ProgressBar(total, done, width=24), f"{done}/{total}", words)
        return Group(bars, self._status())

    def _counts(self) -> list[tuple[str, int, int]]:
        settled = {stage: counts.total() for stage, counts in self._outcomes.items()}
        return [(stage, done, done + len(self._left[stage])) for stage, done in settled.items()]

    def _status(self) -> str:
        seconds = self.seconds_to_go()
        overdue = seconds == 0 and any(self._left.values())
        to_go = "longer than expected" if overdue else f"{duration(seconds)} to go"
        return f"{to_go}, {self._busy} of {self._total} workers busy"

    def _pace(self, stage: str) -> float:
        """Return the ratio of seconds taken to expected: of this stage, or of all where none of it ended."""
        if self._expected[stage]:
            return self._took[stage] / self._expected[stage]
        expected = sum(self._expected.values())
        return sum(self._took.values()) / expected if expected else 1.0

    def _spent_now(self) -> float:
        """Return the worker seconds on tasks that have not ended, as of now."""
        now = self._clock()
        self._spent += self._busy * (now - self._spent_at)
        self._spent_at = now
        return self._spent

    def _chain(self, object_id: str) -> float:
        """Return the seconds of the longest chain of tasks left of an object."""
        ready: dict[str, float] = {}
        for stage, before in self._stages.items():
            own = self._pace(stage) * self._left[stage].get(object_id, 0.0)
            ready[stage] = own + max((ready.get(other, 0.0) for other in before), default=0.0)
        return max(ready.values(), default=0.0)


def duration(seconds: float) -> str:
    """Return seconds in the unit that suits them."""
    for size, unit, decimals in ((1, "s", 0), (60, "min", 0), (3600, "h", 1)):
        if seconds < 100 * size:
            return f"{max(0.0, seconds) / size:.{decimals}f} {unit}"
    return f"{seconds / 86400:.1f} days"


def _words(counts: Counter[str]) -> str:
    return ", ".join(f"{number} {outcome}" for outcome, number in sorted(counts.items())) or "no object"
