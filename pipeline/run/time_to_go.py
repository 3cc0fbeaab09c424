"""How long a run still takes: the CPU seconds that its tasks need, over those that the machine gives them.

Each task has an expected number of CPU seconds. Tasks of a stage that ended correct it for the
others. What the machine gives is measured, so a machine that is busy with other work is accounted for.
"""

import heapq
import math
import statistics
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence

Task = tuple[float, str, str]  # the smallest begins first; stage and object

PRIOR = 0.07  # share of the expected seconds that counts as needed as expected, before any task ended
SPREAD = 0.6  # standard deviation of the CPU seconds of a task over those expected, of views and modes
LEAST = 0.05  # of what a task has used, that it goes on to use at least
TAIL = 0.25  # of what a task has used beyond what was expected, that it goes on to use, too
WINDOW_S = 120.0  # of the past, whose pace is that of the future
PRIOR_S = 2.0  # at full pace, that count as seen before a run begins
# With more tasks left, only sums are looked at: the work shared evenly is what takes longest then, and the
# chains of a hundred thousand objects take seconds to add up.
MOST_CHAINED = 10_000


class CpuClock:
    """The CPU seconds that a task would have got that ran from the beginning.

    Parameters
    ----------
    clock
        Wall seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._used: Callable[[], float | None] = lambda: None
        self._last_s, self._last_used_s = clock(), 0.0
        self._ended_cpu_s = self._ended_wall_s = 0.0
        self._busy = 0
        self.now_s = self._wall_s = 0.0  # both stand while no task runs
        self._past: deque[tuple[float, float]] = deque([(0.0, 0.0)])

    def measure(self, used: Callable[[], float | None]) -> None:
        """Take the CPU seconds used so far from `used`; None where tasks run on other machines."""
        self._used = used
        self._last_used_s = used() or 0.0

    def tick(self, busy: int | None = None) -> None:
        """Look at both clocks; from now on `busy` tasks run (default: as many as before)."""
        now_s, used_s = self._clock(), self._used()
        passed_s = now_s - self._last_s
        if self._busy:
            given_s = self._pace_of_ended() * passed_s
            if used_s is not None:  # a process that has just ended may not be counted at its parent yet
                given_s = max(0.0, used_s - self._last_used_s) / self._busy
            self.now_s += given_s
            self._wall_s += passed_s
            self._past.append((self._wall_s, self.now_s))
            while self._past[1][0] <= self._wall_s - WINDOW_S:
                self._past.popleft()
        self._last_s, self._last_used_s = now_s, max(self._last_used_s, used_s or 0.0)
        self._busy = self._busy if busy is None else busy

    def end(self, cpu_s: float, wall_s: float) -> None:
        """Note what a task that ended used."""
        self._ended_cpu_s += cpu_s
        self._ended_wall_s += wall_s

    def pace(self) -> float:
        """Return the CPU seconds that a running task got in a second, lately."""
        if self._used() is None:
            return self._pace_of_ended()
        wall_s, cpu_s = self._past[0]
        prior_s = PRIOR_S if wall_s == 0 else 0.0
        return (self.now_s - cpu_s + prior_s) / (self._wall_s - wall_s + prior_s)

    def _pace_of_ended(self) -> float:
        return (self._ended_cpu_s + PRIOR_S) / (self._ended_wall_s + PRIOR_S)


class TimeToGo:
    """Tasks of several stages that are left, and how long they take.

    Parameters
    ----------
    stages
        Each with those that it waits for.
    clock
        Of the CPU seconds that a running task gets.
    """

    def __init__(self, stages: Mapping[str, Sequence[str]], clock: CpuClock) -> None:
        self._stages, self._clock = stages, clock
        self._left: dict[str, dict[str, float]] = {stage: {} for stage in stages}  # object to CPU seconds
        self._left_s = dict.fromkeys(stages, 0.0)  # their sums
        self._expected, self._used = dict.fromkeys(stages, 0.0), dict.fromkeys(stages, 0.0)  # ended tasks
        self._waiting: list[Task] = []  # tasks that can begin, as a heap
        self._since: dict[Task, float] = {}  # tasks that seem to run, to when they began: workers do not say

    def expect(self, stage: str, object_id: str, cpu_s: float) -> None:
        """Count a task that is expected to need `cpu_s`."""
        self._left_s[stage] += cpu_s - self._left[stage].get(object_id, 0.0)
        self._left[stage][object_id] = cpu_s

    def submit(self, stage: str, object_id: str, cpu_s: float, priority: float) -> None:
        """Note that a task can begin, which is now expected to need `cpu_s`."""
        self.expect(stage, object_id, cpu_s)
        heapq.heappush(self._waiting, (-priority, stage, object_id))

    def settle(self, stage: str, object_id: str, cpu_s: float, wall_s: float) -> None:
        """Note that a task ended, with what it used; 0 where none ran."""
        expected = self._left[stage].pop(object_id, 0.0)
        self._left_s[stage] -= expected
        if cpu_s <= 0:
            return
        self._clock.end(cpu_s, wall_s)
        if self._since:
            # What ran is the one that is told. Where another seemed to, that began as long ago.
            own, began = (stage, object_id), self._clock.now_s - cpu_s
            self._stop(min(self._since, key=lambda one: (one[1:] != own, abs(self._since[one] - began))))
        self._expected[stage] += expected
        self._used[stage] += cpu_s

    def run(self, busy: int) -> None:
        """Note how many tasks run; they are those with the highest priority."""
        while len(self._since) > busy:
            self._stop(next(reversed(self._since)))
        while len(self._since) < busy and self._waiting:
            task = heapq.heappop(self._waiting)
            if task[2] in self._left[task[1]]:
                self._since[task] = self._clock.now_s

    def count(self, stage: str) -> int:
        """Return how many tasks of a stage are left."""
        return len(self._left[stage])

    def seconds(self, workers: int) -> tuple[float, float, float]:
        """Return wall seconds to go, and CPU seconds left and used.

        No schedule is faster than the work shared evenly, or than the chain of an object that ends last.
        """
        running_s = sum(self._clock.now_s - since for since in self._since.values())
        if sum(map(len, self._left.values())) > MOST_CHAINED:
            ratios = self._ratios()
            work_s = sum(ratio * self._left_s[stage] for stage, ratio in ratios.items())
            work_s, last_s = max(0.0, work_s - running_s), 0.0
        else:
            left = self._cpu_seconds_left()
            work_s = sum(sum(own.values()) for own in left.values())
            last_s = _last_end_s(self._chains(left), max(1, workers))
        to_go_s = max(work_s / max(1, workers), last_s) / self._clock.pace()
        return to_go_s, work_s, sum(self._used.values()) + running_s

    def _stop(self, task: Task) -> None:
        """Take a task for one that does not run: it ended, or another one ran."""
        del self._since[task]
        heapq.heappush(self._waiting, task)

    def _chains(self, left: Mapping[str, Mapping[str, float]]) -> list[tuple[float, float]]:
        """Return CPU seconds and variance of the unfinished part of each object's longest chain of tasks."""
        ready: dict[str, dict[str, tuple[float, float]]] = {}
        for stage, before in self._stages.items():
            ready[stage] = {}
            for name, cpu_s in left[stage].items():
                ends = [ready[other][name] for other in before if name in ready.get(other, {})]
                begin, variance = max(ends, default=(0.0, 0.0))
                ready[stage][name] = begin + cpu_s, variance + (SPREAD * cpu_s) ** 2
        chains: dict[str, tuple[float, float]] = {}
        for ends_of in ready.values():
            for name, end in ends_of.items():
                chains[name] = max(end, chains.get(name, end))
        return list(chains.values())

    def _ratios(self) -> dict[str, float]:
        """Return the CPU seconds that a task of each stage needs over those expected, by those that ended."""
        expected = {stage: self._left_s[stage] + self._expected[stage] for stage in self._left}
        prior = PRIOR * sum(expected.values())
        usual = (sum(self._used.values()) + prior) / ((sum(self._expected.values()) + prior) or 1.0)
        ratios = {}
        for stage in self._left:
            # The fewer tasks of a stage ended, the more those of all count.
            prior = PRIOR * expected[stage]
            ratios[stage] = (self._used[stage] + prior * usual) / ((self._expected[stage] + prior) or 1.0)
        return ratios

    def _cpu_seconds_left(self) -> dict[str, dict[str, float]]:
        """Return the CPU seconds left of each task by stage and object, at the ratio of those that ended."""
        left = {
            stage: {name: ratio * cpu_s for name, cpu_s in self._left[stage].items()}
            for stage, ratio in self._ratios().items()
        }
        for (_, stage, name), since in self._since.items():
            used = self._clock.now_s - since
            late = used - left[stage].get(name, 0.0)
            left[stage][name] = max(-late, LEAST * used + TAIL * max(0.0, late))
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
