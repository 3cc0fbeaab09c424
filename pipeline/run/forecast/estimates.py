"""Estimates of the seconds, memory and bytes of tasks, from measured costs.

The cost of an object and stage that ran here before is what it took last. Otherwise it is what the stage
took on the scans that the package was tried on, times the pace of this data set: the median ratio of what its
own tasks took to what those scans foretell. ``known_costs.csv`` beside this module has the scans: each object
and stage at the default size, one thread a task; ``python -m bench.known_costs`` wrote it. A stage without
packaged costs is estimated from its own tasks.

Seconds and memory of modes grow with a power of the load (`pipeline.run.forecast.loads`). Packaged costs of
rendering are scaled by views x pixels x samples, those of touching by touches x pixels.

Memory errs high: `MEMORY_MARGIN` times the largest peak of that object, or a law that `HIGH_QUANTILE` of the
other objects lie below, with the same margin.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from pipeline.dataset.parameters import Parameters
from pipeline.run.costs import QUERY, Cost, known_costs, read_costs
from pipeline.run.forecast.loads import Loads

PACKAGED = Path(__file__).with_name("known_costs.csv")
MEMORY_MARGIN = 1.15
HIGH_QUANTILE = 0.95
ENOUGH_ROWS = 10  # to fit a power of the load
RENDERING = "views"
UNKNOWN_SECONDS_A_BYTE = 1e-6  # of a stage that is known nowhere: only the order counts
UNKNOWN_MEMORY_BYTES = 500_000_000

# The default size, at which the packaged costs were taken: camera rays, pixels of views, pixels of touches.
PACKAGED_RAYS = (100 * 32 + 12 * 256) * 128**2
PACKAGED_VIEW_PIXELS = 112 * 128**2
PACKAGED_TOUCH_PIXELS = 150 * 160 * 120


@dataclass(frozen=True)
class Estimate:
    """The expected cost of a task.

    Parameters
    ----------
    wall_s, cpu_s
        Seconds on one core: the mean of tasks like it.
    memory_bytes
        Peak of its process, on the high side.
    product_bytes
        Of the products it makes.
    known
        Whether this object and stage ran here before.
    """

    wall_s: float
    cpu_s: float
    memory_bytes: int
    product_bytes: int
    known: bool = False


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
    cpu: PowerLaw
    memory: PowerLaw
    product_bytes: int = 0

    def at(self, load: float | None) -> Estimate:
        """Return the expected cost of a task with this load."""
        memory_bytes = int(self.memory.at(load))
        return Estimate(self.wall.at(load), self.cpu.at(load), memory_bytes, self.product_bytes)


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
        self._parameters = parameters
        self._loads = Loads(root, parameters)
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
            seconds = UNKNOWN_SECONDS_A_BYTE * (size_bytes or 0)
            return Estimate(seconds, seconds, UNKNOWN_MEMORY_BYTES, 0)
        own = self._own.get((object_id, stage))
        if own is None:
            return model.at(self._loads.of(stage, object_id))
        memory = int(own.memory_bytes * MEMORY_MARGIN)
        if (
            stage == RENDERING
        ):  # Cycles is a process of its own, whose peak is noted only if it is a worker's first
            memory = max(memory, int(model.memory.level))
        return Estimate(own.wall_s, own.cpu_s, memory, model.product_bytes, known=True)

    def _model(self, stage: str) -> Model | None:
        own = [
            replace(one, load=self._loads.of(stage, one.object_id))
            for one in self._own.values()
            if one.stage == stage
        ]
        model = _packaged_model(stage)
        if model is None:
            return fit(own) if own else None
        if self._parameters is not None:
            seconds, size = scales(stage, self._parameters)
            size_bytes = int(model.product_bytes * size)
            model = Model(model.wall.times(seconds), model.cpu.times(seconds), model.memory, size_bytes)
        if not own:
            return model
        peaks = [one.memory_bytes * MEMORY_MARGIN / model.memory.at(one.load) for one in own]
        return Model(
            model.wall.times(float(np.median([one.wall_s / model.wall.at(one.load) for one in own]))),
            model.cpu.times(float(np.median([one.cpu_s / model.cpu.at(one.load) for one in own]))),
            model.memory.times(max(1.0, _high(peaks))),
            model.product_bytes,
        )


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
    return Model(
        _mean_law(loads, [one.wall_s for one in tasks]),
        _mean_law(loads, [one.cpu_s for one in tasks]),
        memory.times(MEMORY_MARGIN * _high(over)),
        int(np.mean([one.product_bytes for one in tasks])),
    )


def scales(stage: str, parameters: Parameters) -> tuple[float, float]:
    """Return by what factors seconds and bytes of a stage differ from those at the default size."""
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


@cache
def _packaged_model(stage: str) -> Model | None:
    tasks = [one for one in packaged_costs() if one.stage == stage]
    return fit(tasks) if tasks else None


def _high(values: Sequence[float]) -> float:
    return float(np.quantile(values, HIGH_QUANTILE, method="higher"))


def _mean_law(loads: Sequence[float | None], values: Sequence[float]) -> PowerLaw:
    law = _law(loads, values)
    return law.times(
        float(np.mean([value / law.at(load) for load, value in zip(loads, values, strict=True)]))
    )


def _law(loads: Sequence[float | None], values: Sequence[float]) -> PowerLaw:
    """Return the law that half of the values lie above, with the Theil-Sen slope of the logarithms."""
    positive = [max(value, 1e-3) for value in values]
    loaded = [(load, value) for load, value in zip(loads, positive, strict=True) if load]
    if len(loaded) < ENOUGH_ROWS:
        return PowerLaw(float(np.median(positive)))
    from scipy.stats import theilslopes  # only where there is something to compute

    x, y = np.log(loaded).T
    exponent = float(theilslopes(y, x).slope)
    usual = float(np.median(x))
    return PowerLaw(math.exp(float(np.median(y - exponent * (x - usual)))), math.exp(usual), exponent)
