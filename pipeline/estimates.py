"""What a task will take, before it runs: seconds, memory and bytes, from what is known of others.

In this order: what the same object and stage took last in this data set; a model of what others of this
stage took here; a model of what it took on the scans the package was tried on (`pipeline.known_costs`).
A model is the median, times a power of the input's bytes where these explain anything (Theil-Sen slope of
the logarithms whose 95 % interval is clear of zero).

Times and bytes of the packaged costs follow the parameters where the law is plain: rendering goes with
views x pixels x samples, touching with touches x pixels, and so do the bytes of both with views x pixels and
touches x pixels. Modes, encoding and verification are taken as they were at the default size. Costs known
from this data set are taken as they were, whatever its parameters were then.

Memory errs high: `MEMORY_MARGIN` times the largest peak of that object, else the `MEMORY_QUANTILE` of
others. Cycles renders in a process of its own, whose peak is noted for the first task of a worker only, so
that no rendering is taken to need less than the usual one.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.known_costs import KnownCost, costs_of, input_bytes, packaged_costs
from pipeline.parameters import Parameters

MEMORY_MARGIN = 1.15
MEMORY_QUANTILE = 0.95
ENOUGH_ROWS = 10  # of this data set, to leave the packaged costs aside
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
        Seconds on one core.
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
        self._root = root
        self._parameters = parameters
        self._own: dict[tuple[str, str], KnownCost] = {}
        self._by_stage: dict[str, list[KnownCost]] = {}
        for cost in costs_of(root):
            self._own[cost.object_id, cost.stage] = cost
            self._by_stage.setdefault(cost.stage, []).append(cost)
        self._models: dict[str, _Model] = {}

    def of(self, stage: str, object_id: str, size_bytes: int | None = None) -> Estimate:
        """Return what the task of an object is expected to take.

        Parameters
        ----------
        stage
            Name of the stage.
        object_id
            Of an object, known or not.
        size_bytes
            Bytes of the files it reads; None where they do not exist yet.
        """
        model = self._model(stage)
        usual = model.of(size_bytes)
        own = self._own.get((object_id, stage))
        if own is None:
            return usual
        memory = int(own.memory_bytes * MEMORY_MARGIN)
        if stage == RENDERING:
            memory = max(memory, usual.memory_bytes)
        return Estimate(own.wall_s, own.cpu_s, memory, usual.product_bytes, known=True)

    def _model(self, stage: str) -> "_Model":
        if stage not in self._models:
            self._models[stage] = self._fitted(stage)
        return self._models[stage]

    def _fitted(self, stage: str) -> "_Model":
        rows = self._by_stage.get(stage, [])
        packaged = _packaged_model(stage)
        if packaged is not None and self._parameters is not None:
            packaged = packaged.scaled(*_scales(stage, self._parameters))
        if not rows:
            return packaged or _Model(wall=None, cpu=None)
        here = rows[:: math.ceil(len(rows) / MOST_ROWS)]
        sizes = [input_bytes(self._root, stage, cost.object_id) for cost in here]
        own = _Model(
            _PowerLaw.fitted(sizes, [cost.wall_s for cost in here]),
            _PowerLaw.fitted(sizes, [cost.cpu_s for cost in here]),
            _high([cost.memory_bytes for cost in rows]),
            packaged.product_bytes if packaged else 0,
        )
        if packaged is None or len(rows) >= ENOUGH_ROWS:
            return own
        # Few rows say how fast this machine is, but not how memory spreads, nor how sizes matter.
        return _Model(
            packaged.wall_times(_pace(packaged.wall, sizes, [cost.wall_s for cost in here])),
            packaged.cpu_times(_pace(packaged.cpu, sizes, [cost.cpu_s for cost in here])),
            max(own.memory_bytes, packaged.memory_bytes),
            packaged.product_bytes,
        )


@dataclass(frozen=True)
class _PowerLaw:
    """``level (size / usual_size) ** exponent``."""

    level: float
    usual_size: float = 1.0
    exponent: float = 0.0

    def of(self, size: int | None) -> float:
        if not size or not self.exponent:
            return self.level
        return self.level * (size / self.usual_size) ** self.exponent

    @classmethod
    def fitted(cls, sizes: Iterable[int | None], values: Iterable[float]) -> "_PowerLaw":
        pairs = [(size, max(value, 1e-3)) for size, value in zip(sizes, values, strict=True)]
        level = float(np.median([value for _, value in pairs]))
        sized = np.log([(size, value) for size, value in pairs if size]).reshape(-1, 2)
        if len(sized) < ENOUGH_ROWS:
            return cls(level)
        x, y = sized.T
        exponent = _theil_sen(x, y)
        usual = float(np.median(x))
        return cls(float(np.exp(np.median(y - exponent * (x - usual)))), math.exp(usual), exponent)


@dataclass(frozen=True)
class _Model:
    """What tasks of a stage take."""

    wall: _PowerLaw | None
    cpu: _PowerLaw | None
    memory_bytes: int = UNKNOWN_MEMORY_BYTES
    product_bytes: int = 0

    def of(self, size: int | None) -> Estimate:
        unknown = UNKNOWN_SECONDS_A_BYTE * (size or 0)
        return Estimate(
            self.wall.of(size) if self.wall else unknown,
            self.cpu.of(size) if self.cpu else unknown,
            self.memory_bytes,
            self.product_bytes,
        )

    def scaled(self, seconds: float, size: float) -> "_Model":
        return _Model(
            self.wall_times(seconds),
            self.cpu_times(seconds),
            self.memory_bytes,
            int(self.product_bytes * size),
        )

    def wall_times(self, factor: float) -> _PowerLaw | None:
        return _times(self.wall, factor)

    def cpu_times(self, factor: float) -> _PowerLaw | None:
        return _times(self.cpu, factor)


def _times(law: _PowerLaw | None, factor: float) -> _PowerLaw | None:
    return law and _PowerLaw(law.level * factor, law.usual_size, law.exponent)


def _pace(law: _PowerLaw | None, sizes: list[int | None], values: list[float]) -> float:
    """Return the median of the values over what the law says of them."""
    if law is None:
        return 1.0
    return float(np.median([value / law.of(size) for size, value in zip(sizes, values, strict=True)]))


@cache
def _packaged_model(stage: str) -> _Model | None:
    rows = [cost for cost in packaged_costs() if cost.stage == stage]
    if not rows:
        return None
    sizes = [cost.input_bytes for cost in rows]
    # One thread a task: alone on its core, its wall seconds are its CPU seconds.
    cpu = _PowerLaw.fitted(sizes, [cost.cpu_s for cost in rows])
    made = [cost.product_bytes for cost in rows if cost.product_bytes is not None]
    return _Model(cpu, cpu, _high([cost.memory_bytes for cost in rows]), int(np.median(made)) if made else 0)


def _high(peaks: list[int]) -> int:
    """Return the quantile of peaks with its margin, by the next observation above."""
    return int(MEMORY_MARGIN * float(np.quantile(peaks, MEMORY_QUANTILE, method="higher")))


def _scales(stage: str, parameters: Parameters) -> tuple[float, float]:
    """Return by what seconds and bytes of a stage differ from those at the default size."""
    vision, touch = parameters.vision, parameters.touch
    if stage == RENDERING:
        pixels = vision.resolution**2
        views = vision.training_views + vision.held_out_views
        rays = pixels * (
            vision.training_views * vision.training_samples + vision.held_out_views * vision.held_out_samples
        )
        return rays / PACKAGED_RAYS, views * pixels / PACKAGED_VIEW_PIXELS
    if stage == "touches":
        height, width = touch.sensor["image_height"], touch.sensor["image_width"]
        pixels = (touch.touches + touch.held_out_touches) * height * width
        return (pixels / PACKAGED_TOUCH_PIXELS,) * 2
    return 1.0, 1.0


def _theil_sen(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
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
