"""Estimates of the seconds, memory and bytes of tasks: means of stages, corrected by what was measured.

A task that ran here before is expected to take what it took last, another one of its stage the mean of the
last that ran here. Before any ran, it is the mean of `TYPICAL`, as the parameters scale it.

Memory errs high: `MEMORY_MARGIN` times the largest peak of the object, or of all of its stage.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean

from pipeline.dataset.measures import IN_CONDITIONS
from pipeline.dataset.parameters import Parameters
from pipeline.run.costs import QUERY, Cost, known_costs

MEMORY_MARGIN = 1.15
MOST_ROWS = 100  # of a stage, the last of which set its mean
ENOUGH_ROWS = 10  # whose largest peak stands for the others'
RENDERING = "views"


@dataclass(frozen=True)
class Estimate:
    """The cost of a task, expected or measured: CPU seconds on one thread, highest peak, bytes made."""

    cpu_s: float
    memory_bytes: int
    product_bytes: int = 0


# Means of a hundred scans (`bench/factory/known_costs.csv`), of the memory the 95th percentile: 100 training
# views of 128 pixels, 150 touches of 160 x 120, sight learned in 1200 steps.
TYPICAL: Mapping[str, Estimate] = {
    "objects": Estimate(0.43, 170_000_000, 1_560_000),
    "views": Estimate(48.4, 500_000_000, 4_070_000),
    "modes": Estimate(42.3, 4_400_000_000, 6_760_000),
    "touches": Estimate(1.2, 510_000_000, 6_180_000),
    "collision": Estimate(6.1, 720_000_000, 11_000),
    "encode": Estimate(75.7, 1_600_000_000, 865_000),
    "fidelity": Estimate(9.6, 1_080_000_000, 1_990_000),
}
UNKNOWN = Estimate(60.0, 500_000_000)  # of a stage that is known nowhere: long enough for a cluster
TYPICAL_RAYS = (100 * 32 + 12 * 256) * 128**2
TYPICAL_VIEW_PIXELS = 112 * 128**2
TYPICAL_TOUCH_PIXELS = 150 * 160 * 120
TYPICAL_STEPS = 1200
FITTING_SHARE = 0.65  # of the seconds of encoding, that fits sight
PYRENDER_TIMES = 10.0  # as long as compiled: 12 CPU-s for 150 touches by Mesa


class Estimates:
    """Estimates for the tasks of one data set.

    Parameters
    ----------
    root
        Root of the data set; its costs are read at once, and not again.
    parameters
        What typical costs are scaled to; the default size without them.
    """

    def __init__(self, root: Path, parameters: Parameters | None = None) -> None:
        self._parameters = parameters
        self._own = last_costs(known_costs(root))
        self._means: dict[str, Estimate] = {}

    def of(self, stage: str, object_id: str) -> Estimate:
        """Return the expected cost of the task of an object, known or not, in a stage by its name."""
        mean = self.mean(stage)
        own = self._own.get((object_id, stage))
        if own is None:
            return mean
        memory = int(own.memory_bytes * MEMORY_MARGIN)
        if stage == RENDERING:
            # Cycles is a process of its own, whose peak is noted only if it is a worker's first.
            memory = max(memory, mean.memory_bytes)
        return Estimate(own.cpu_s, memory, mean.product_bytes)

    def mean(self, stage: str) -> Estimate:
        """Return the expected cost of the task of any object in a stage."""
        if stage not in self._means:
            typical = scaled(stage, TYPICAL.get(stage, UNKNOWN), self._parameters)
            own = [cost for (_, made_by), cost in self._own.items() if made_by == stage][-MOST_ROWS:]
            if own:
                peak = int(MEMORY_MARGIN * max(cost.memory_bytes for cost in own))
                seconds = fmean(cost.cpu_s for cost in own)
                least = typical.memory_bytes if len(own) < ENOUGH_ROWS else 0
                typical = replace(typical, cpu_s=seconds, memory_bytes=max(peak, least))
            self._means[stage] = typical
        return self._means[stage]


def last_costs(costs: Iterable[Cost]) -> dict[tuple[str, str], Estimate]:
    """Return what the last task of each object and stage took, with the largest peak of all of them.

    The largest counts, because a peak of child processes is noted only where it exceeds those of earlier
    tasks in the same process.
    """
    last: dict[tuple[str, str], Estimate] = {}
    for cost in costs:
        if cost.stage == QUERY or cost.cpu_s is None or cost.peak_memory_mb is None:
            continue
        key = cost.object_id, cost.stage
        peak = max(int(cost.peak_memory_mb * 1e6), last[key].memory_bytes if key in last else 0)
        last[key] = Estimate(cost.cpu_s, peak)
    return last


def scaled(stage: str, typical: Estimate, parameters: Parameters | None) -> Estimate:
    """Return a typical cost as these parameters make it."""
    if parameters is None:
        return typical
    seconds, size = 1.0, 1.0
    vision, touch = parameters.vision, parameters.touch
    if stage == RENDERING:
        pixels = vision.resolution**2
        rays = vision.training_views * vision.training_samples
        rays += vision.held_out_views * vision.held_out_samples
        seconds = pixels * rays / TYPICAL_RAYS
        # A view in other conditions costs as much as one of 128 pixels a side, whatever those.
        conditions = len(IN_CONDITIONS) * vision.condition_views * vision.held_out_samples
        seconds += 128**2 * conditions / TYPICAL_RAYS
        size = pixels * (vision.training_views + vision.held_out_views) / TYPICAL_VIEW_PIXELS
    elif stage == "touches":
        pixels = touch.sensor["image_height"] * touch.sensor["image_width"]
        size = (touch.touches + touch.held_out_touches) * pixels / TYPICAL_TOUCH_PIXELS
        seconds = size * (PYRENDER_TIMES if touch.renderer == "pyrender" else 1.0)
    elif stage == "encode":
        sight = parameters.encode.visionnet
        steps = sight.steps if sight.material == "learned" else 0
        seconds = 1.0 + FITTING_SHARE * (steps / TYPICAL_STEPS - 1.0)
    return replace(typical, cpu_s=typical.cpu_s * seconds, product_bytes=int(typical.product_bytes * size))
