"""How long a flow over several stages still takes, from expected seconds and what tasks took so far.

Work left over workers, or the longest chain of tasks of one object that is left, whichever is longer:
no schedule is faster (Graham 1969).
"""

from collections.abc import Callable, Mapping, Sequence


class TimeToGo:
    """Expected seconds of tasks left, corrected by stage for how long tasks really took.

    Parameters
    ----------
    stages
        Names of the stages in order, each with those it waits for.
    clock
        Seconds that pass.
    """

    def __init__(self, stages: Mapping[str, Sequence[str]], clock: Callable[[], float]) -> None:
        self._stages = stages
        self._clock = clock
        self._left: dict[str, dict[str, float]] = {stage: {} for stage in stages}  # object to seconds
        self._sums = dict.fromkeys(stages, 0.0)
        self._expected = dict.fromkeys(stages, 0.0)  # of the tasks that ended
        self._took = dict.fromkeys(stages, 0.0)
        self._ended = dict.fromkeys(stages, 0)
        self._earliest: dict[str, float] = {}  # object to the time before which it cannot be ready
        self._changed: set[str] = set()  # objects whose time has yet to be found
        self._total = 1
        self._busy = 0
        self._since = clock()
        self._busy_seconds = 0.0

    def expect(self, stage: str, object_id: str, seconds: float) -> None:
        """Add a task, or correct what is expected of it."""
        self._sums[stage] += seconds - self._left[stage].get(object_id, 0.0)
        self._left[stage][object_id] = seconds
        self._changed.add(object_id)

    def settle(self, stage: str, object_id: str, seconds: float) -> None:
        """Take away a task that took `seconds`, 0 where it was not needed."""
        expected = self._left[stage].pop(object_id, 0.0)
        self._sums[stage] -= expected
        if seconds > 0:
            self._expected[stage] += expected
            self._took[stage] += seconds
            self._ended[stage] += 1
        self._changed.discard(object_id)
        if any(object_id in left for left in self._left.values()):
            self._earliest[object_id] = self._clock() + self._chain(object_id)
        else:
            self._earliest.pop(object_id, None)

    def workers(self, busy: int, total: int) -> None:
        """Note how many workers there are, and how many work from now on."""
        now = self._clock()
        self._busy_seconds += self._busy * (now - self._since)
        self._since, self._busy, self._total = now, busy, total

    def left(self) -> int:
        """Return how many tasks are left."""
        return sum(map(len, self._left.values()))

    def left_by_stage(self) -> dict[str, int]:
        """Return how many tasks are left, by stage."""
        return {stage: len(left) for stage, left in self._left.items()}

    def seconds(self) -> float | None:
        """Return the seconds to go; None while nothing says how long tasks take."""
        work = sum(self._pace(stage) * seconds for stage, seconds in self._sums.items())
        if work <= 0:
            return None
        now = self._clock()
        # What running tasks have behind them: the time workers were busy, less that of tasks that ended.
        busy = self._busy_seconds + self._busy * (now - self._since)
        work -= min(work, max(0.0, busy - sum(self._took.values())))
        self._earliest.update({object_id: now + self._chain(object_id) for object_id in self._changed})
        self._changed.clear()
        chain = max(self._earliest.values(), default=now) - now
        return max(work / max(1, self._total), chain, 0.0)

    def _pace(self, stage: str) -> float:
        """Return the ratio of seconds taken to expected; one task as expected weighs in for the start."""
        if not self._ended[stage] or not self._expected[stage]:
            return 1.0
        usual = self._expected[stage] / self._ended[stage]
        return (self._took[stage] + usual) / (self._expected[stage] + usual)

    def _chain(self, object_id: str) -> float:
        """Return the seconds of the longest chain of tasks of an object that is left."""
        ready: dict[str, float] = {}
        for stage, before in self._stages.items():
            own = self._pace(stage) * self._left[stage].get(object_id, 0.0)
            ready[stage] = own + max((ready.get(other, 0.0) for other in before), default=0.0)
        return max(ready.values(), default=0.0)
