"""Progress of running stages: a line on a terminal, and now and then in a log."""

import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TextIO

from pipeline.run.display import Display

PRIOR = 0.02  # share of the expected seconds that counts as needed as expected, before any task ended
LEAST = 0.05  # of what running tasks have used, that they go on to use at least
LATE = 0.25  # the same, of those that run last


class FlowProgress:
    """Seconds done and left of several stages, objects settled in each, busy workers and time to go.

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
        self._stream, self._clock, self._stages = stream or sys.stderr, clock, stages
        self._outcomes: dict[str, Counter[str]] = {stage: Counter() for stage in stages}
        self._left: dict[str, dict[str, float]] = {stage: {} for stage in stages}  # object to seconds
        self._left_s = dict.fromkeys(stages, 0.0)  # their sums
        self._expected_s = self._taken_s = 0.0  # of tasks that ended
        self._busy, self._total = 0, 1
        self._running_s, self._last_s = 0.0, clock()  # seconds of tasks that run, up to the last look
        self._lock = threading.Lock()
        self._display = Display(self.line, self._stream)

    def expect(self, stage: str, object_id: str, seconds: float) -> None:
        """Count an object as left in a stage; its task is expected to take so long."""
        with self._lock:
            self._left_s[stage] += seconds - self._left[stage].get(object_id, 0.0)
            self._left[stage][object_id] = seconds

    def settle(self, stage: str, object_id: str, outcome: str, wall_s: float = 0.0) -> None:
        """Count the outcome of an object in a stage, and what its task took, 0 where none ran."""
        with self._lock:
            self._look()
            self._outcomes[stage][outcome] += 1
            expected_s = self._left[stage].pop(object_id, 0.0)
            self._left_s[stage] -= expected_s
            if wall_s > 0:
                self._expected_s += expected_s
                self._taken_s += wall_s
                self._running_s = max(0.0, self._running_s - wall_s)

    def workers(self, busy: int, total: int) -> None:
        """Note how many workers there are and how many are busy; the first call begins to show."""
        with self._lock:
            self._look()
            self._busy, self._total = busy, total
            is_unfinished = any(self._left.values())
        if is_unfinished:
            self._display.start()

    def _look(self) -> None:
        now_s = self._clock()
        self._running_s += self._busy * (now_s - self._last_s)
        self._last_s = now_s

    def close(self) -> None:
        """Stop, and write the outcomes of each stage on a line."""
        self._display.stop()
        for stage, counts in self._outcomes.items():
            print(f"{stage}: {_words(counts)}", file=self._stream, flush=True)

    def line(self) -> str:
        """Return the state in one line."""
        return " | ".join([self._status(*self.state()), *self._shares()])

    def state(self) -> tuple[float, float, float]:
        """Return wall seconds to go, and seconds of tasks left and done.

        What the tasks that ended took over what they were expected to take corrects the others. No schedule
        is faster than the work shared evenly, or than the longest chain of tasks of one object.
        """
        with self._lock:
            self._look()
            left_s = sum(self._left_s.values())
            prior_s = PRIOR * (left_s + self._expected_s)
            ratio = (self._taken_s + prior_s) / ((self._expected_s + prior_s) or 1.0)
            work_s = max(ratio * left_s - self._running_s, LEAST * self._running_s)
            ends: dict[str, float] = {}
            for stage, before in self._stages.items():
                mean_s = ratio * self._left_s[stage] / (len(self._left[stage]) or 1)
                ends[stage] = mean_s + max((ends.get(name, 0.0) for name in before), default=0.0)
            chain_s = max(ends.values(), default=0.0)
            if (
                self._busy
                and next((len(seconds) for seconds in self._left.values() if seconds), 0) <= self._busy
            ):
                run_s = self._running_s / self._busy  # else a chain is left that has not begun
                chain_s = max(chain_s - run_s, LATE * run_s)
            return max(work_s / max(1, self._total), chain_s), work_s, self._taken_s + self._running_s

    def _status(self, to_go_s: float, left_s: float, done_s: float) -> str:
        share = done_s / ((left_s + done_s) or 1.0)
        return f"{share:.0%}, {duration(to_go_s)} to go, {self._busy} of {self._total} workers busy"

    def _shares(self) -> list[str]:
        counts = ((stage, outcomes.total()) for stage, outcomes in self._outcomes.items())
        return [f"{stage} {count}/{count + len(self._left[stage])}" for stage, count in counts]


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
