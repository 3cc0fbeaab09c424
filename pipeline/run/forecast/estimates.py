"""What a task will take, before it runs: seconds, memory and bytes, from what is known of others.

In this order: what the same object and stage took last in this data set; a model of what others of this
stage took here; a model of what it took on the scans the package was tried on (`known_costs.py`). A model
is the median, times a power of the task's load (`loads.py`) where that explains anything: the Theil-Sen slope
of the logarithms, if its 95 % interval is clear of zero.

Of the packaged costs, those of rendering follow views x pixels x samples and those of touching touches x
pixels; the bytes of both follow views x pixels and touches x pixels. The rest is taken as it was at the
default size. What is known from this data set is taken as it was, whatever its parameters were then.

Memory errs high: `MEMORY_MARGIN` times the largest peak of that object, else the same margin on a model of
others, raised until `HIGH_QUANTILE` of them lie below. Cycles renders in a process of its own, whose peak is
noted only for the first task of a worker, so that no rendering is taken to need less than the usual one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.parameters import Parameters
from pipeline.run.forecast.known_costs import KnownCost, costs_of, packaged_costs
from pipeline.run.forecast.loads import Loads

MEMORY_MARGIN = 1.15
HIGH_QUANTILE = 0.95
ENOUGH_ROWS = 10  # of this data set, to leave the packaged costs aside; with a load, to fit a slope
MOST_ROWS = 400  # that a model is fitted to
RENDERING = "views"
UNKNOWN_SECONDS_A_BYTE = 1e-6  # of a stage that is known nowhere: only the order counts
UNKNOWN_MEMORY_BYTES = 500_000_000

# The default size, at which the packaged costs were taken: camera rays, pixels of views, pixels of touches.
PACKAGED_RAYS = (100 * 32 + 12 * 256) * 128**2
PACKAGED_VIEW_PIXELS = 112 * 128**2
PACKAGED_TOUCH_PIXELS = 150 * 160 * 120


@dataclass(frozen=True)
class Estimate:
    """What a task is expected to take.

    Parameters
    ----------
    wall_s, cpu_s
        Seconds on one core, as many tasks take more as take less.
    high_wall_s
        Seconds that few tasks like it exceed. Which task to start first is better judged by these: one whose
        length is uncertain may turn out to be the longest, and then must not have been started last.
    memory_bytes
        Peak of its process, on the high side.
    product_bytes
        Of the products it makes.
    known
        Whether this object and stage ran here before.
    """

    wall_s: float
    cpu_s: float
    high_wall_s: float
    memory_bytes: int
    product_bytes: int
    known: bool = False


@dataclass(frozen=True)
class PowerLaw:
    """``level (load / usual_load) ** exponent``."""

    level: float
    usual_load: float = 1.0
    exponent: float = 0.0

    def of(self, load: float | None) -> float:
        """Return the value at a load; the level where it is None."""
        if not load or not self.exponent:
            return self.level
        return self.level * (load / self.usual_load) ** self.exponent

    def times(self, factor: float) -> "PowerLaw":
        """Return the law that gives `factor` times its values."""
        return replace(self, level=self.level * factor)


@dataclass(frozen=True)
class Model:
    """What tasks of a stage take, by their load.

    Parameters
    ----------
    wall, cpu
        Seconds: the median.
    memory
        Bytes that few exceed.
    spread, mean, deviation
        Of the ratio of a task's seconds to the median at its load: what few exceed, mean, and standard
        deviation.
    product_bytes
        The median.
    rows
        Tasks it was fitted to.
    """

    wall: PowerLaw
    cpu: PowerLaw
    memory: PowerLaw
    spread: float = 1.0
    mean: float = 1.0
    deviation: float = 0.0
    product_bytes: int = 0
    rows: int = 1

    def of(self, load: float | None) -> Estimate:
        """Return what a task with this load is expected to take."""
        wall_s = self.wall.of(load)
        memory_bytes = int(self.memory.of(load))
        return Estimate(wall_s, self.cpu.of(load), self.spread * wall_s, memory_bytes, self.product_bytes)


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
        self._own: dict[tuple[str, str], KnownCost] = {}
        self._by_stage: dict[str, list[KnownCost]] = {}
        for cost in costs_of(root):
            self._own[cost.object_id, cost.stage] = cost
            self._by_stage.setdefault(cost.stage, []).append(cost)
        self._models: dict[str, Model | None] = {}

    def of(self, stage: str, object_id: str, size_bytes: int | None = None) -> Estimate:
        """Return what the task of an object is expected to take.

        Parameters
        ----------
        stage
            Name of the stage.
        object_id
            Of an object, known or not.
        size_bytes
            Bytes of the first file it reads (the mesh for the first stage, else the object's product); None
            where that does not exist yet.
        """
        model = self.model(stage)
        if model is None:
            seconds = UNKNOWN_SECONDS_A_BYTE * (size_bytes or 0)
            return Estimate(seconds, seconds, seconds, UNKNOWN_MEMORY_BYTES, 0)
        own = self._own.get((object_id, stage))
        if own is None:
            return model.of(self._loads.of(stage, object_id, size_bytes))
        memory = int(own.memory_bytes * MEMORY_MARGIN)
        if stage == RENDERING:
            memory = max(memory, int(model.memory.level))
        return Estimate(own.wall_s, own.cpu_s, own.wall_s, memory, model.product_bytes, known=True)

    def model(self, stage: str) -> Model | None:
        """Return what is known of the tasks of a stage; None for nothing."""
        if stage not in self._models:
            self._models[stage] = self._fitted(stage)
        return self._models[stage]

    def _fitted(self, stage: str) -> Model | None:
        packaged = _packaged_model(stage)
        if packaged is not None and self._parameters is not None:
            packaged = _scaled(packaged, stage, self._parameters)
        rows = self._by_stage.get(stage, [])
        if not rows:
            return packaged
        rows = [
            replace(cost, load=self._loads.of(stage, cost.object_id))
            for cost in rows[:: math.ceil(len(rows) / MOST_ROWS)]
        ]
        own = fit(rows)
        if packaged is None:
            return own
        if len(rows) >= ENOUGH_ROWS:
            return replace(own, product_bytes=packaged.product_bytes)
        # Few rows say how fast this machine is, but not how memory spreads, nor what loads mean.
        over = (cost.memory_bytes * MEMORY_MARGIN / packaged.memory.of(cost.load) for cost in rows)
        return replace(
            packaged,
            wall=packaged.wall.times(_pace(packaged.wall, rows, [cost.wall_s for cost in rows])),
            cpu=packaged.cpu.times(_pace(packaged.cpu, rows, [cost.cpu_s for cost in rows])),
            memory=packaged.memory.times(max(1.0, *over)),
        )


def fit(rows: Sequence[KnownCost]) -> Model:
    """Return the model of the tasks of a stage; at least one is needed."""
    loads = [cost.load for cost in rows]
    peaks = [float(cost.memory_bytes) for cost in rows]
    # A peak that misses the child says nothing of its load.
    memory = _law([None] * len(rows) if rows[0].stage == RENDERING else loads, peaks)
    over = [peak / memory.of(load) for peak, load in zip(peaks, loads, strict=True)]
    made = [cost.product_bytes for cost in rows if cost.product_bytes is not None]
    cpu = _law(loads, [cost.cpu_s for cost in rows])
    # CPU seconds, because what else the machine did meanwhile is no property of the tasks.
    longer = [cost.cpu_s / cpu.of(cost.load) for cost in rows]
    return Model(
        _law(loads, [cost.wall_s for cost in rows]),
        cpu,
        memory.times(MEMORY_MARGIN * _high(over)),
        max(1.0, _high(longer)),
        float(np.mean(longer)),
        float(np.std(longer)),
        int(np.median(made)) if made else 0,
        len(rows),
    )


def _high(values: Sequence[float]) -> float:
    return float(np.quantile(values, HIGH_QUANTILE, method="higher"))


def _law(loads: Sequence[float | None], values: Sequence[float]) -> PowerLaw:
    positive = [max(value, 1e-3) for value in values]
    loaded = [(load, value) for load, value in zip(loads, positive, strict=True) if load]
    if len(loaded) < ENOUGH_ROWS:
        return PowerLaw(float(np.median(positive)))
    x, y = np.log(loaded).T
    exponent, usual = _slope(x, y), float(np.median(x))
    return PowerLaw(math.exp(float(np.median(y - exponent * (x - usual)))), math.exp(usual), exponent)


def _slope(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Return the median slope between pairs, 0 where its 95 % interval (Sen 1968) has zero in it."""
    first, second = np.triu_indices(len(x), 1)
    run, rise = x[second] - x[first], y[second] - y[first]
    slopes = np.sort(rise[run != 0] / run[run != 0])
    if not len(slopes):
        return 0.0
    n = len(x)
    half = 1.96 * math.sqrt(n * (n - 1) * (2 * n + 5) / 18) / 2
    low = slopes[max(0, math.floor(len(slopes) / 2 - half))]
    high = slopes[min(len(slopes) - 1, math.ceil(len(slopes) / 2 + half))]
    return 0.0 if low <= 0 <= high else float(np.median(slopes))


def _pace(law: PowerLaw, rows: Sequence[KnownCost], seconds: Sequence[float]) -> float:
    return float(np.median([took / law.of(cost.load) for cost, took in zip(rows, seconds, strict=True)]))


@cache
def _packaged_model(stage: str) -> Model | None:
    rows = [cost for cost in packaged_costs() if cost.stage == stage]
    # One thread a task: alone on its core, its wall seconds are its CPU seconds.
    return replace(model := fit(rows), wall=model.cpu) if rows else None


def _scaled(model: Model, stage: str, parameters: Parameters) -> Model:
    """Return the packaged model at other parameters than those of the default size."""
    seconds, size = scales(stage, parameters)
    return replace(
        model,
        wall=model.wall.times(seconds),
        cpu=model.cpu.times(seconds),
        product_bytes=int(model.product_bytes * size),
    )


def scales(stage: str, parameters: Parameters) -> tuple[float, float]:
    """Return by what factors seconds and bytes of a stage differ from those at the default size."""
    vision, touch = parameters.vision, parameters.touch
    if stage == RENDERING:
        pixels = vision.resolution**2
        views = vision.training_views + vision.held_out_views
        shots = (
            vision.training_views * vision.training_samples + vision.held_out_views * vision.held_out_samples
        )
        return pixels * shots / PACKAGED_RAYS, pixels * views / PACKAGED_VIEW_PIXELS
    if stage == "touches":
        pixels = touch.sensor["image_height"] * touch.sensor["image_width"]
        factor = (touch.touches + touch.held_out_touches) * pixels / PACKAGED_TOUCH_PIXELS
        return factor, factor
    return 1.0, 1.0
