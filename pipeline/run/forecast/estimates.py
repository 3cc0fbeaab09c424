"""Estimates of the seconds, memory and bytes of tasks, from measured costs.

The cost of an object and stage that ran here before is what it took last. Otherwise it is what the stage
took on the scans that the package was tried on, times the pace of this data set: the median ratio of what
its own tasks took to what those scans foretell. ``known_costs.csv`` beside this module has the scans: each
object and stage at the default size, but of 100 training views with sight learned, one thread a task;
``python -m bench.factory.known_costs`` wrote it. A stage without packaged costs is estimated from its own
tasks. The objects of the starter set, which most first runs make, have costs of their own in
``starter_costs.csv``.

Seconds and memory of modes grow with a power of the load (`bending_modes`). Packaged costs of rendering are
scaled by views x pixels x samples, those of touching by touches x pixels, and the share of encoding that fits
sight by its steps.

Memory errs high: `MEMORY_MARGIN` times the largest peak of that object, or a law that `HIGH_QUANTILE` of the
other objects lie below, with the same margin.
"""

import contextlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import FormatError, InputError
from objectfolder.products.store import read_attributes
from pipeline.dataset.parameters import Parameters
from pipeline.dataset.records import read_records
from pipeline.dataset.stages import FIDELITY, MODES, OBJECTS, STAGES
from pipeline.run.costs import QUERY, Cost, known_costs, read_costs
from pipeline.run.forecast import machine

PACKAGED = Path(__file__).with_name("known_costs.csv")
STARTER = Path(__file__).with_name("starter_costs.csv")  # of the starter set at the default size
STARTER_TABLE = "data/starter.csv"
MEMORY_MARGIN = 1.15
HIGH_QUANTILE = 0.95
LATE_ERRORS = 2.0  # standard errors by which few tasks exceed their estimates
ENOUGH_ROWS = 10  # to fit a power of the load
MOST_ROWS = 100  # of this data set that set its pace
RENDERING = "views"
UNKNOWN = 60.0, 60.0, 500_000_000  # of a stage that is known nowhere: long enough for a cluster

# The size at which the packaged costs were taken: camera rays, pixels of views, pixels of touches.
PACKAGED_RAYS = (100 * 32 + 12 * 256) * 128**2
PACKAGED_VIEW_PIXELS = 112 * 128**2
PACKAGED_TOUCH_PIXELS = 150 * 160 * 120
PYRENDER_TIMES = 10.0  # as long as compiled: 12 CPU-s for 150 touches by Mesa
PACKAGED_FREQUENCY_HZ = 20_000.0
PACKAGED_STEPS = 1200
FITTING_SHARE = 0.65  # of the seconds of encoding: what the die took with 300 steps and with 1200


@dataclass(frozen=True)
class Estimate:
    """The cost of a task, expected or measured: seconds on one core, highest peak, bytes made."""

    wall_s: float
    cpu_s: float
    memory_bytes: int
    product_bytes: int = 0
    load: float | None = None  # what the cost grows with
    error_s: float = 0.0  # standard error of the wall seconds; none where they were measured here

    @property
    def late_s(self) -> float:
        """Wall seconds that few tasks like it exceed."""
        return self.wall_s + LATE_ERRORS * self.error_s

    def times(self, seconds: float, memory: float = 1.0, size: float = 1.0) -> "Estimate":
        """Return it with seconds, memory and bytes multiplied."""
        return replace(
            self,
            wall_s=self.wall_s * seconds,
            cpu_s=self.cpu_s * seconds,
            memory_bytes=int(self.memory_bytes * memory),
            product_bytes=int(self.product_bytes * size),
            error_s=self.error_s * seconds,
        )


@dataclass(frozen=True)
class Model:
    """The cost of tasks of a stage: mean seconds, and memory that few exceed, each by a power of the load."""

    usual: Estimate  # at the usual load, and without any
    seconds_exponent: float
    memory_exponent: float

    def at(self, load: float | None) -> Estimate:
        """Return the expected cost of a task with this load."""
        if not load or not self.usual.load:
            return self.usual
        ratio = load / self.usual.load
        at_load = self.usual.times(ratio**self.seconds_exponent, ratio**self.memory_exponent)
        return replace(at_load, error_s=self.usual.error_s)


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
        self._starter = parameters is not None and parameters.objects.table == STARTER_TABLE
        self._materials: dict[str, Mapping[str, float]] | None = None
        self._own = last_costs(known_costs(root))
        self._models: dict[str, Model | None] = {}

    def of(self, stage: str, object_id: str) -> Estimate:
        """Return the expected cost of the task of an object, known or not, in a stage by its name."""
        if stage not in self._models:
            self._models[stage] = self._model(stage)
        model = self._models[stage]
        if model is None:
            return Estimate(*UNKNOWN)
        own = self._own.get((object_id, stage))
        if own is None:
            expected = model.at(self.load(stage, object_id))
            known = starter_costs().get((object_id, stage)) if self._starter else None
            if known is None:
                return expected
            seconds = self._scaled(stage, known).cpu_s
            return replace(expected, wall_s=seconds, cpu_s=seconds, error_s=0.0)
        memory = int(own.memory_bytes * MEMORY_MARGIN)
        if stage == RENDERING:
            # Cycles is a process of its own, whose peak is noted only if it is a worker's first.
            memory = max(memory, model.usual.memory_bytes)
        return Estimate(own.wall_s, own.cpu_s, memory, model.usual.product_bytes)

    def cpu_s(self, stage: str, object_id: str) -> float:
        """Return the CPU seconds that a task is expected to need on this machine.

        Where nothing of this data set ran here, packaged costs are scaled by how fast the machine is.
        """
        return self.of(stage, object_id).cpu_s * (1.0 if self._own else machine.slowness())

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
        """Return expected costs by object and stage, of objects that have a cost of the last stage.

        These are objects of this data set if there are enough, else the packaged ones, whose CPU seconds
        stand for wall seconds. A stage that an object has no cost of takes what is usual.
        """
        own = _finished(self._own)
        if len(own) >= ENOUGH_ROWS:
            return {name: {stage: self.of(stage, name) for stage in STAGES} for name in own}
        known = packaged_costs()

        def expected(stage: str, name: str) -> Estimate:
            one = known.get((name, stage))
            return self._scaled(stage, one, MEMORY_MARGIN) if one else self.of(stage, name)

        return {name: {stage: expected(stage, name) for stage in STAGES} for name in _finished(known)}

    def _scaled(self, stage: str, one: Estimate, memory: float = 1.0) -> Estimate:
        """Return a cost at the default size as it is with this data set's parameters."""
        seconds, size = scales(stage, self._parameters)
        return one.times(seconds, memory, size)

    def _model(self, stage: str) -> Model | None:
        sample = [(name, one) for (name, made_by), one in self._own.items() if made_by == stage][-MOST_ROWS:]
        own = [replace(one, load=self.load(stage, name)) for name, one in sample]
        packaged = [one for (_, made_by), one in packaged_costs().items() if made_by == stage]
        if not packaged:
            return fit(own) if own else None
        model = fit(packaged)
        model = replace(model, usual=self._scaled(stage, model.usual))
        if not own:
            return model
        foretold = [model.at(one.load) for one in own]
        pairs = list(zip(own, foretold, strict=True))
        pace = float(np.median([one.wall_s / expected.wall_s for one, expected in pairs]))
        peak = _high([one.memory_bytes * MEMORY_MARGIN / expected.memory_bytes for one, expected in pairs])
        usual = model.usual.times(pace, max(1.0, peak))
        return replace(model, usual=replace(usual, cpu_s=usual.wall_s * _cpu_share(own)))


def last_costs(costs: Iterable[Cost]) -> dict[tuple[str, str], Estimate]:
    """Return what the last task of each object and stage took, with the largest peak of all of them.

    The largest counts, because a peak of child processes is noted only where it exceeds those of earlier
    tasks in the same process.
    """
    found: dict[tuple[str, str], Estimate] = {}
    for cost in costs:
        if cost.stage == QUERY or cost.wall_s is None or cost.cpu_s is None or cost.peak_memory_mb is None:
            continue
        key = cost.object_id, cost.stage
        peak = max(int(cost.peak_memory_mb * 1e6), found[key].memory_bytes if key in found else 0)
        found[key] = Estimate(cost.wall_s, cost.cpu_s, peak, int(cost.product_bytes or 0), cost.load)
    return found


def _finished(tasks: Mapping[tuple[str, str], Estimate]) -> list[str]:
    """Return the objects with a task of the last stage."""
    return [object_id for object_id, stage in tasks if stage == FIDELITY.made_by]


@cache
def packaged_costs() -> Mapping[tuple[str, str], Estimate]:
    """Return the packaged costs of the scans, by object and stage."""
    # With one thread and a core of its own, a task's wall seconds are its CPU seconds.
    return {key: replace(one, wall_s=one.cpu_s) for key, one in last_costs(read_costs(PACKAGED)).items()}


@cache
def starter_costs() -> Mapping[tuple[str, str], Estimate]:
    """Return the packaged costs of the starter set, by object and stage."""
    return last_costs(read_costs(STARTER))


def fit(tasks: Sequence[Estimate]) -> Model:
    """Return the model of the tasks of a stage; at least one is needed."""
    loads = [one.load for one in tasks]
    usual_load, wall_s, seconds_exponent = _law(loads, [one.wall_s for one in tasks])
    _, _, memory_exponent = _law(loads, [float(one.memory_bytes) for one in tasks])
    ratios = [load / usual_load if load and usual_load else 1.0 for load in loads]
    shape = np.array([ratio**seconds_exponent for ratio in ratios])
    taken = np.array([one.wall_s for one in tasks])
    wall_s *= float(np.mean(taken / (wall_s * shape)))
    peaks = [one.memory_bytes / ratio**memory_exponent for one, ratio in zip(tasks, ratios, strict=True)]
    usual = Estimate(
        wall_s,
        wall_s * _cpu_share(tasks),
        int(MEMORY_MARGIN * _high(peaks)),
        int(np.mean([one.product_bytes for one in tasks])),
        usual_load,
        float(np.std(taken - wall_s * shape)),
    )
    return Model(usual, seconds_exponent, memory_exponent)


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
        return factor * (PYRENDER_TIMES if touch.renderer == "pyrender" else 1.0), factor
    if stage == "encode":
        sight = parameters.encode.visionnet
        steps = sight.steps if sight.material == "learned" else 0
        return 1.0 + FITTING_SHARE * (steps / PACKAGED_STEPS - 1.0), 1.0
    return 1.0, 1.0


def _cpu_share(tasks: Sequence[Estimate]) -> float:
    return sum(one.cpu_s for one in tasks) / max(sum(one.wall_s for one in tasks), 1e-9)


def _high(values: Sequence[float]) -> float:
    return float(np.quantile(values, HIGH_QUANTILE, method="higher"))


def _law(loads: Sequence[float | None], values: Sequence[float]) -> tuple[float | None, float, float]:
    """Return load, value and exponent of the law that half of the values lie above.

    The exponent is the Theil-Sen slope of the logarithms. Without enough loads it is 0, the load None.
    """
    positive = [max(value, 1e-3) for value in values]
    loaded = [(load, value) for load, value in zip(loads, positive, strict=True) if load]
    if len(loaded) < ENOUGH_ROWS:
        return None, float(np.median(positive)), 0.0
    x, y = np.log(loaded).T
    run, rise = (values[:, None] - values for values in (x, y))
    # As `scipy.stats.theilslopes`, whose import takes longer than a run with nothing else to do.
    exponent = float(np.median(rise[run > 0] / run[run > 0])) if np.ptp(x) else 0.0
    usual = float(np.median(x))
    return math.exp(usual), math.exp(float(np.median(y - exponent * (x - usual)))), exponent


def bending_modes(
    measured: Mapping[str, Any], material: Mapping[str, float], frequency_hz: float
) -> float | None:
    """Return about how many bending modes an object has below a frequency, as if it were a plate.

    N = √3 S f / (h c), with S half the area, h the thickness of thin walls and c the longitudinal wave speed
    of a plate (Cremer and Heckl, Structure-Borne Sound): the finer an object bends, the more unknowns its
    solution has. Over a hundred scans its rank correlation is 0.86 with CPU seconds and 0.85 with memory;
    nothing known of the other stages foretells their memory.

    Parameters
    ----------
    measured
        Attributes of the object's product.
    material
        ``youngs_modulus_pa``, ``density_kg_m3``, ``poisson_ratio``.
    frequency_hz
        Highest frequency.
    """
    walls = measured["wall_thickness"]
    thickness = walls["thin_m"] or walls["median_m"] or walls["effective_m"]
    if not thickness:
        return None
    stiffness = material["youngs_modulus_pa"] / (1 - material["poisson_ratio"] ** 2)
    wave_speed = math.sqrt(stiffness / material["density_kg_m3"])
    return math.sqrt(3) * measured["area_m2"] / 2 * frequency_hz / (thickness * wave_speed)
