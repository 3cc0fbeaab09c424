"""Estimates of the seconds, memory and bytes of tasks, from measured costs.

The cost of an object and stage that ran here before is what it took last. Otherwise it is what the stage
took on the scans that the package was tried on, times the pace of this data set: the median ratio of what
its own tasks took to what those scans foretell. ``known_costs.csv`` beside this module has the scans: each
object and stage at the default size, one thread a task; ``python -m bench.factory.known_costs`` wrote it. A
stage without packaged costs is estimated from its own tasks.

Seconds and memory of modes grow with a power of the load (`pipeline.run.forecast.loads`). Packaged costs of
rendering are scaled by views x pixels x samples, those of touching by touches x pixels.

Memory errs high: `MEMORY_MARGIN` times the largest peak of that object, or a law that `HIGH_QUANTILE` of the
other objects lie below, with the same margin.
"""

import contextlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from objectfolder.errors import FormatError, InputError
from objectfolder.products.store import read_attributes
from pipeline.dataset.parameters import Parameters
from pipeline.dataset.records import read_records
from pipeline.dataset.stages import MODES, OBJECTS, STAGES
from pipeline.run.costs import QUERY, Cost, known_costs, read_costs
from pipeline.run.forecast.loads import bending_modes

PACKAGED = Path(__file__).with_name("known_costs.csv")
MEMORY_MARGIN = 1.15
HIGH_QUANTILE = 0.95
LATE_ERRORS = 2.0  # standard errors by which few tasks exceed their estimates
ENOUGH_ROWS = 10  # to fit a power of the load
MOST_ROWS = 100  # of this data set that set its pace
RENDERING = "views"
# Of a stage that is known nowhere: long enough for a cluster, and in the order of the bytes that it reads.
UNKNOWN_SECONDS, UNKNOWN_SECONDS_A_BYTE = 60.0, 1e-6
UNKNOWN_MEMORY_BYTES = 500_000_000

# The default size, at which the packaged costs were taken: camera rays, pixels of views, pixels of touches.
PACKAGED_RAYS = (100 * 32 + 12 * 256) * 128**2
PACKAGED_VIEW_PIXELS = 112 * 128**2
PACKAGED_TOUCH_PIXELS = 150 * 160 * 120
PACKAGED_FREQUENCY_HZ = 20_000.0


@dataclass(frozen=True)
class Estimate:
    """The expected cost of a task: seconds on one core, highest peak of its process, bytes that it makes."""

    wall_s: float
    cpu_s: float
    memory_bytes: int
    product_bytes: int
    error_s: float = 0.0  # standard error of the wall seconds; none where they were measured here

    @property
    def late_s(self) -> float:
        """Wall seconds that few tasks like it exceed."""
        return self.wall_s + LATE_ERRORS * self.error_s


@dataclass(frozen=True)
class Taken:
    """The cost of one task: seconds, peak in bytes, load, bytes of its products."""

    object_id: str
    stage: str
    wall_s: float
    cpu_s: float
    memory_bytes: int
    load: float | None = None
    product_bytes: int = 0


@dataclass(frozen=True)
class PowerLaw:
    """``level (load / usual_load) ** exponent``; the level where there is no load."""

    level: float
    usual_load: float = 1.0
    exponent: float = 0.0

    def at(self, load: float | None) -> float:
        """Return the value at a load."""
        return self.level * (load / self.usual_load) ** self.exponent if load else self.level

    def times(self, factor: float) -> "PowerLaw":
        """Return the law that gives `factor` times its values."""
        return replace(self, level=self.level * factor)


@dataclass(frozen=True)
class Model:
    """The cost of tasks of a stage by their load: mean seconds, and bytes of memory that few exceed."""

    wall: PowerLaw
    cpu_share: float  # CPU seconds a wall second
    memory: PowerLaw
    product_bytes: int = 0
    error_share: float = 0.0  # standard error, of the wall seconds in the middle

    def at(self, load: float | None) -> Estimate:
        """Return the expected cost of a task with this load."""
        wall_s = self.wall.at(load)
        cpu_s, error_s = wall_s * self.cpu_share, self.wall.level * self.error_share
        return Estimate(wall_s, cpu_s, int(self.memory.at(load)), self.product_bytes, error_s)


class Estimates:
    """Estimates for the tasks of one data set.

    Parameters
    ----------
    root
        Root of the data set; its costs are read at once, and not again.
    parameters
        What the packaged costs are scaled to; the default size without them.
    """

    def __init__(self, root: Path, parameters: Parameters | None = None) -> None:
        self._root, self._parameters = root, parameters
        self._materials: dict[str, Mapping[str, float]] | None = None
        self._own = {(one.object_id, one.stage): one for one in last_taken(known_costs(root))}
        self._models: dict[str, Model | None] = {}

    def of(self, stage: str, object_id: str, size_bytes: int | None = None) -> Estimate:
        """Return the expected cost of the task of an object.

        Parameters
        ----------
        stage
            Name of the stage.
        object_id
            Of an object, known or not.
        size_bytes
            Bytes of the first file it reads: orders the tasks of a stage of which no cost is known.
        """
        if stage not in self._models:
            self._models[stage] = self._model(stage)
        model = self._models[stage]
        if model is None:
            seconds = UNKNOWN_SECONDS + UNKNOWN_SECONDS_A_BYTE * (size_bytes or 0)
            return Estimate(seconds, seconds, UNKNOWN_MEMORY_BYTES, 0)
        own = self._own.get((object_id, stage))
        if own is None:
            return model.at(self.load(stage, object_id))
        memory = int(own.memory_bytes * MEMORY_MARGIN)
        if stage == RENDERING:
            # Cycles is a process of its own, whose peak is noted only if it is a worker's first.
            memory = max(memory, int(model.memory.level))
        return Estimate(own.wall_s, own.cpu_s, memory, model.product_bytes)

    def load(self, stage: str, object_id: str) -> float | None:
        """Return the load of a task; None for other stages than modes, and for an object not measured yet."""
        if stage != MODES.made_by:
            return None
        if self._materials is None:
            self._materials = {}
            with contextlib.suppress(InputError):
                rows = read_records(self._root).rows
                self._materials = {name: row["material"] for name, row in rows.items()}
        frequency_hz = self._parameters.audio.max_frequency_hz if self._parameters else PACKAGED_FREQUENCY_HZ
        try:
            measured = read_attributes(OBJECTS.path(self._root, object_id))
            return bending_modes(measured, self._materials[object_id], frequency_hz)
        except (OSError, FormatError, KeyError, TypeError, ValueError, ArithmeticError):
            return None  # no product, or one with impossible attributes; the run reports it

    def of_known_objects(self) -> dict[str, dict[str, Estimate]]:
        """Return expected costs by object and stage, of objects that have costs of every stage.

        These are objects of this data set if there are enough, else the packaged ones, whose CPU seconds
        stand for wall seconds.
        """
        own = _complete(self._own.values())
        if len(own) >= ENOUGH_ROWS:
            return {name: {stage: self.of(stage, name) for stage in STAGES} for name in own}
        return {
            name: {stage: self._scaled(one) for stage, one in by_stage.items()}
            for name, by_stage in _complete(packaged_costs()).items()
        }

    def _scaled(self, one: Taken) -> Estimate:
        """Return the cost of a packaged object with this data set's parameters."""
        seconds, size = scales(one.stage, self._parameters)
        cpu_s, memory = one.cpu_s * seconds, int(one.memory_bytes * MEMORY_MARGIN)
        return Estimate(cpu_s, cpu_s, memory, int(one.product_bytes * size))

    def _model(self, stage: str) -> Model | None:
        sample = [one for one in self._own.values() if one.stage == stage][-MOST_ROWS:]
        own = [replace(one, load=self.load(stage, one.object_id)) for one in sample]
        packaged = [one for one in packaged_costs() if one.stage == stage]
        if not packaged:
            return fit(own) if own else None
        model = fit(packaged)
        seconds, size = scales(stage, self._parameters)
        model = replace(model, wall=model.wall.times(seconds), product_bytes=int(model.product_bytes * size))
        if not own:
            return model
        peaks = [one.memory_bytes * MEMORY_MARGIN / model.memory.at(one.load) for one in own]
        pace = float(np.median([one.wall_s / model.wall.at(one.load) for one in own]))
        memory = model.memory.times(max(1.0, _high(peaks)))
        return replace(model, wall=model.wall.times(pace), cpu_share=_cpu_share(own), memory=memory)


def last_taken(costs: Iterable[Cost]) -> list[Taken]:
    """Return what the last task of each object and stage took, with the largest peak of all of them.

    The largest counts, because a peak of child processes is noted only where it exceeds those of earlier
    tasks in the same process.
    """
    found: dict[tuple[str, str], Taken] = {}
    for cost in costs:
        if cost.stage == QUERY or cost.wall_s is None or cost.cpu_s is None or cost.peak_memory_mb is None:
            continue
        before = found.get((cost.object_id, cost.stage))
        found[cost.object_id, cost.stage] = Taken(
            cost.object_id,
            cost.stage,
            cost.wall_s,
            cost.cpu_s,
            max(int(cost.peak_memory_mb * 1e6), before.memory_bytes if before else 0),
            cost.load,
            int(cost.product_bytes or 0),
        )
    return list(found.values())


def _complete(tasks: Iterable[Taken]) -> dict[str, dict[str, Taken]]:
    """Return the tasks by object and stage, of the objects that have one in every stage."""
    found: dict[str, dict[str, Taken]] = {}
    for one in tasks:
        if one.stage in STAGES:
            found.setdefault(one.object_id, {})[one.stage] = one
    return {name: by_stage for name, by_stage in found.items() if len(by_stage) == len(STAGES)}


@cache
def packaged_costs() -> tuple[Taken, ...]:
    """Return the packaged costs of the scans."""
    # With one thread and a core of its own, a task's wall seconds are its CPU seconds.
    return tuple(replace(one, wall_s=one.cpu_s) for one in last_taken(read_costs(PACKAGED)))


def fit(tasks: Sequence[Taken]) -> Model:
    """Return the model of the tasks of a stage; at least one is needed."""
    loads = [one.load for one in tasks]
    peaks = [float(one.memory_bytes) for one in tasks]
    memory = _law(loads, peaks)
    over = [peak / memory.at(load) for load, peak in zip(loads, peaks, strict=True)]
    wall_s = [one.wall_s for one in tasks]
    wall = _law(loads, wall_s)
    mean = np.mean([seconds / wall.at(load) for load, seconds in zip(loads, wall_s, strict=True)])
    wall = wall.times(float(mean))
    errors = [seconds - wall.at(load) for load, seconds in zip(loads, wall_s, strict=True)]
    return Model(
        wall,
        _cpu_share(tasks),
        memory.times(MEMORY_MARGIN * _high(over)),
        int(np.mean([one.product_bytes for one in tasks])),
        float(np.std(errors)) / wall.level,
    )


def scales(stage: str, parameters: Parameters | None) -> tuple[float, float]:
    """Return by what factors seconds and bytes of a stage differ from those at the default size."""
    if parameters is None:
        return 1.0, 1.0
    vision, touch = parameters.vision, parameters.touch
    if stage == RENDERING:
        pixels = vision.resolution**2
        views = vision.training_views + vision.held_out_views
        rays = pixels * (
            vision.training_views * vision.training_samples + vision.held_out_views * vision.held_out_samples
        )
        return rays / PACKAGED_RAYS, pixels * views / PACKAGED_VIEW_PIXELS
    if stage == "touches":
        pixels = touch.sensor["image_height"] * touch.sensor["image_width"]
        factor = (touch.touches + touch.held_out_touches) * pixels / PACKAGED_TOUCH_PIXELS
        return factor, factor
    return 1.0, 1.0


def _cpu_share(tasks: Sequence[Taken]) -> float:
    return sum(one.cpu_s for one in tasks) / max(sum(one.wall_s for one in tasks), 1e-9)


def _high(values: Sequence[float]) -> float:
    return float(np.quantile(values, HIGH_QUANTILE, method="higher"))


def _law(loads: Sequence[float | None], values: Sequence[float]) -> PowerLaw:
    """Return the law that half of the values lie above, with the Theil-Sen slope of the logarithms."""
    positive = [max(value, 1e-3) for value in values]
    loaded = [(load, value) for load, value in zip(loads, positive, strict=True) if load]
    if len(loaded) < ENOUGH_ROWS:
        return PowerLaw(float(np.median(positive)))
    x, y = np.log(loaded).T
    run, rise = (values[:, None] - values for values in (x, y))
    # As `scipy.stats.theilslopes`, whose import takes longer than a run with nothing else to do.
    exponent = float(np.median(rise[run > 0] / run[run > 0])) if np.ptp(x) else 0.0
    usual = float(np.median(x))
    return PowerLaw(math.exp(float(np.median(y - exponent * (x - usual)))), math.exp(usual), exponent)
