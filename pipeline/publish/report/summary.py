"""The data set in a few rows: measures, cost of the stages, definitions and split."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.dataset.measures import BYTES, HEADLINE, Measure, number_at
from pipeline.publish.report.measured_objects import MeasuredObject, stage_names

COST = Measure("cpu_seconds", "Cost, mesh to verified file", "CPU s", 0, False, "", 240.0)


@dataclass(frozen=True)
class MeasureSummary:
    """A measure over the objects that have it; all numbers are None where none has.

    Parameters
    ----------
    values
        Value and id of each object.
    trivial
        Mean score of the trivial answer.
    """

    measure: Measure
    values: Sequence[tuple[float, str]]
    trivial: float | None = None

    @property
    def mean(self) -> float | None:
        """Mean over the objects."""
        return mean([value for value, _ in self.values])

    @property
    def median(self) -> float | None:
        """Median over the objects."""
        return statistics.median([value for value, _ in self.values]) if self.values else None

    @property
    def worst(self) -> float | None:
        """Worst of the objects."""
        return self.measure.worst([value for value, _ in self.values]) if self.values else None

    @property
    def worst_object(self) -> str:
        """Id of the worst object, empty for none."""
        return next((object_id for value, object_id in self.values if value == self.worst), "")

    @property
    def met(self) -> bool | None:
        """Whether the mean reaches the target; None where there is no target or no mean."""
        if self.mean is None or self.measure.target is None:
            return None
        return self.measure.margin(self.mean) >= 0


def summaries(objects: Sequence[MeasuredObject]) -> list[MeasureSummary]:
    """Return every headline measure and the bytes; silent objects leave those of audio."""
    found = []
    for measure in (*HEADLINE, BYTES):
        counted = [one for one in objects if not (measure.sense == "audio" and one.silent)]
        known = [(value, one) for one in counted if (value := measure.of(one.attributes)) is not None]
        trivial = mean([measure.trivial_of(one.attributes) for _, one in known])
        found.append(MeasureSummary(measure, [(value, one.object_id) for value, one in known], trivial))
    return found


def cost_summary(objects: Sequence[MeasuredObject]) -> MeasureSummary:
    """Return the cost of the objects whose every stage was measured."""
    seconds = [(one.cpu_seconds, one.object_id) for one in objects]
    return MeasureSummary(COST, [(value, object_id) for value, object_id in seconds if value is not None])


def stage_rows(objects: Sequence[MeasuredObject]) -> list[dict[str, Any]]:
    """Return CPU seconds and peak memory of each stage over the objects it was measured for."""
    rows = []
    for stage in stage_names(objects):
        costs = [cost for one in objects if (cost := one.cost(stage))]
        cpu = [cost.cpu_s for cost in costs if cost.cpu_s is not None]
        memory = [cost.peak_memory_mb for cost in costs if cost.peak_memory_mb is not None]
        row = {"stage": stage, "objects": len(cpu), "median": statistics.median(cpu) if cpu else None}
        rows.append({**row, "largest": max(cpu, default=None), "peak_memory_mb": max(memory, default=None)})
    return rows


def definitions_of(objects: Sequence[MeasuredObject]) -> dict[str, str]:
    """Return measure to definition: the products' own words in their order, ours for a headline without."""
    own: dict[str, str] = {}
    for one in objects:
        own |= {str(name): str(text) for name, text in one.part("definitions").items()}
    for measure in HEADLINE:
        if measure.key not in own and measure.name not in own:
            own[measure.key] = measure.definition
    return own


def split(objects: Sequence[MeasuredObject]) -> list[tuple[str, str, list[float], list[float]]]:
    """Return sense, unit, and the distinct counts of training and of held-out queries."""

    def counts(key: str) -> list[float]:
        return sorted({value for one in objects if (value := number_at(one.attributes, key)) is not None})

    return [
        (sense, unit, counts(f"{sense}.training_{queries}"), counts(f"{sense}.held_out_{queries}"))
        for sense, queries, unit in (
            ("vision", "views", "views, each with its own light"),
            ("audio", "points", "surface points"),
            ("touch", "touches", "touches"),
        )
    ]


def mean(values: Sequence[float | None]) -> float | None:
    """Return the mean of the values that are there, None where none is."""
    known = [value for value in values if value is not None]
    return statistics.fmean(known) if known else None
