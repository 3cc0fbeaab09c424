"""Progress of running stages: bars on a terminal, a line now and then in a log."""

import heapq
import math
import statistics
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

Task = tuple[float, str, str]  # the smallest begins first; stage and object

LOG_INTERVAL_S = 30.0
PRIOR = 0.07  # share of the expected seconds that counts as taken as expected, before any task ended
SPREAD = 0.6  # standard deviation of a task's seconds over those expected, of views and modes
TAIL = 0.25  # of what a task has run, that it runs on at least: those that are late are later still


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
        self._waiting: list[Task] = []  # tasks that can begin, as a heap
        self._since: dict[Task, float] = {}  # tasks that seem to run, to when they began: workers do not say
        self._busy, self._total = 0, 1
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)

    def expect(self, stage: str, object_id: str, seconds: float) -> None:
        """Count an object as left in a stage; its task is expected to take `seconds`."""
        with self._lock:
            self._left[stage][object_id] = seconds

    def submit(self, stage: str, object_id: str, seconds: float, priority: float) -> None:
        """Note that a task can begin, which is now expected to take `seconds`."""
        with self._lock:
            self._left[stage][object_id] = seconds
            heapq.heappush(self._waiting, (-priority, stage, object_id))

    def settle(self, stage: str, object_id: str, outcome: str, seconds: float = 0.0) -> None:
        """Count the outcome of an object in a stage; its task took `seconds`, 0 where none ran."""
        with self._lock:
            self._outcomes[stage][outcome] += 1
            expected = self._left[stage].pop(object_id, 0.0)
            if seconds > 0 and self._since:
                # What ran is the one that is told. Where another seemed to, that began as long ago.
                own, began = (stage, object_id), self._clock() - seconds
                self._stop(min(self._since, key=lambda one: (one[1:] != own, abs(self._since[one] - began))))
            if seconds > 0:
                self._expected[stage] += expected
                self._took[stage] += seconds

    def workers(self, busy: int, total: int) -> None:
        """Note how many workers there are and how many are busy; the first call begins to show."""
        with self._lock:
            self._busy, self._total = busy, total
            while len(self._since) > busy:
                self._stop(next(reversed(self._since)))
            while len(self._since) < busy and self._waiting:
                task = heapq.heappop(self._waiting)
                if task[2] in self._left[task[1]]:
                    self._since[task] = self._clock()
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
        """Return work left over workers, or when the last chain of an object may end if that is later."""
        with self._lock:
            left = self._seconds_left()
        workers = max(1, self._total)
        work = sum(sum(seconds.values()) for seconds in left.values())
        return max(work / workers, _last_end_s(self._chains(left), workers))

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
        with Live(
            get_renderable=self._bars,
            console=console,
            transient=True,
            redirect_stdout=screen,
            refresh_per_second=1,
        ):
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
        return f"{duration(seconds)} to go, {self._busy} of {self._total} workers busy"

    def _stop(self, task: Task) -> None:
        """Take a task for one that does not run: it ended, or another one ran."""
        del self._since[task]
        heapq.heappush(self._waiting, task)

    def _chains(self, left: Mapping[str, Mapping[str, float]]) -> list[tuple[float, float]]:
        """Return seconds and variance of what is left of each object's longest chain of tasks."""
        ready: dict[str, dict[str, tuple[float, float]]] = {}
        for stage, before in self._stages.items():
            ready[stage] = {}
            for name, seconds in left[stage].items():
                ends = [ready[other][name] for other in before if name in ready.get(other, {})]
                begin, variance = max(ends, default=(0.0, 0.0))
                ready[stage][name] = begin + seconds, variance + (SPREAD * seconds) ** 2
        chains: dict[str, tuple[float, float]] = {}
        for ends_of in ready.values():
            for name, end in ends_of.items():
                chains[name] = max(end, chains.get(name, end))
        return list(chains.values())

    def _seconds_left(self) -> dict[str, dict[str, float]]:
        """Return the seconds left of every task by stage and object, at the pace of those that ended.

        A task that took longer than expected is expected to go on for `TAIL` of what it has run.
        """
        expected = {name: sum(own.values()) + self._expected[name] for name, own in self._left.items()}
        prior = PRIOR * sum(expected.values())
        usual = (sum(self._took.values()) + prior) / ((sum(self._expected.values()) + prior) or 1.0)
        left = {}
        for stage, own in self._left.items():
            # The fewer tasks of a stage ended, the more the pace of all counts.
            prior = PRIOR * expected[stage]
            pace = (self._took[stage] + prior * usual) / ((self._expected[stage] + prior) or 1.0)
            left[stage] = {name: pace * seconds for name, seconds in own.items()}
        for (_, stage, name), since in self._since.items():
            ran = self._clock() - since
            left[stage][name] = max(left[stage].get(name, 0.0) - ran, TAIL * ran)
        return left


def _last_end_s(chains: list[tuple[float, float]], workers: int) -> float:
    """Return in how many seconds the last of chains (seconds, variance) that run side by side may end.

    It is the longest as expected, or the expected greatest of as many draws from a normal distribution (Blom
    1958): with many chains one is late.
    """
    together = sorted(chains, reverse=True)[:workers]
    if not together:
        return 0.0
    lengths = [seconds for seconds, _ in together]
    spread = math.sqrt(statistics.pvariance(lengths) + statistics.fmean(own for _, own in together))
    greatest = statistics.NormalDist().inv_cdf((len(together) - 0.375) / (len(together) + 0.25))
    return max(lengths[0], statistics.fmean(lengths) + greatest * spread)


def duration(seconds: float) -> str:
    """Return seconds in the unit that suits them."""
    for size, unit, decimals in ((1, "s", 0), (60, "min", 0), (3600, "h", 1)):
        if seconds < 100 * size:
            return f"{max(0.0, seconds) / size:.{decimals}f} {unit}"
    return f"{seconds / 86400:.1f} days"


def _words(counts: Counter[str]) -> str:
    return ", ".join(f"{number} {outcome}" for outcome, number in sorted(counts.items())) or "no object"
