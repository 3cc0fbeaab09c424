"""The data set in a few rows: measures, cost of the stages, definitions and split."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.dataset.measures import HEADLINE, Measure, number_at
from pipeline.publish.report.costs import Costs
from pipeline.publish.report.object_records import Record


@dataclass(frozen=True)
class SummaryRow:
    """A measure over the data set."""

    measure: Measure
    mean: float | None
    worst: float | None
    worst_object: str
    trivial: float | None

    @property
    def met(self) -> bool | None:
        """Whether the mean reaches the target; None where there is no target or no mean."""
        if self.mean is None or self.measure.target is None:
            return None
        return self.measure.margin(self.mean) >= 0


@dataclass(frozen=True)
class StageRow:
    """CPU seconds of a stage over the objects it was measured for."""

    stage: str
    objects: int
    median: float | None
    largest: float | None
    share: float | None
    peak_memory_mb: float | None


def summary_row(measure: Measure, records: Sequence[Record]) -> SummaryRow:
    """Return mean and worst of a measure; silent objects leave those of audio."""
    known = [
        (value, record.object_id)
        for record in records
        if (value := measure.of(record.attributes)) is not None
        and not (measure.sense == "audio" and record.silent)
    ]
    if not known:
        return SummaryRow(measure, None, None, "", None)
    worst = measure.worst([value for value, _ in known])
    return SummaryRow(
        measure,
        statistics.fmean(value for value, _ in known),
        worst,
        next(object_id for value, object_id in known if value == worst),
        mean([measure.trivial_of(record.attributes) for record in records]),
    )


def stage_rows(records: Sequence[Record], costs: Costs) -> list[StageRow]:
    """Return what each stage took, in the order of the pipeline."""
    rows, medians = [], {}
    for stage in costs.stage_names({record.object_id for record in records}):
        found = [costs.stage(record.object_id, stage, record.fingerprints) for record in records]
        cpu = [cost.cpu_s for cost in found if cost and cost.cpu_s is not None]
        memory = [cost.peak_memory_mb for cost in found if cost and cost.peak_memory_mb is not None]
        medians[stage] = statistics.median(cpu) if cpu else None
        rows.append(
            StageRow(stage, len(cpu), medians[stage], max(cpu, default=None), None, max(memory, default=None))
        )
    whole = sum(median for median in medians.values() if median is not None)
    return [
        StageRow(
            row.stage,
            row.objects,
            row.median,
            row.largest,
            row.median / whole if row.median is not None and whole > 0 else None,
            row.peak_memory_mb,
        )
        for row in rows
    ]


def total_cpu_seconds(record: Record, costs: Costs) -> float | None:
    """Return the CPU seconds of every stage of an object, None unless all were measured."""
    stages = costs.stage_names({record.object_id})
    found = [costs.stage(record.object_id, stage, record.fingerprints) for stage in stages]
    seconds = [cost.cpu_s if cost else None for cost in found]
    known = [value for value in seconds if value is not None]
    return sum(known) if len(known) == len(seconds) else None


def definitions_of(records: Sequence[Record]) -> dict[str, str]:
    """Return measure to definition: the products' own words in their order, ours for a headline without."""
    own: dict[str, str] = {}
    for record in records:
        own |= {str(name): str(text) for name, text in record.sense("definitions").items()}
    for measure in HEADLINE:
        if measure.key not in own and measure.name not in own:
            own[measure.key] = measure.definition
    return own


def split(records: Sequence[Record]) -> list[tuple[str, str, list[float], list[float]]]:
    """Return sense, unit, and the distinct counts of training and of held-out queries."""

    def counts(key: str) -> list[float]:
        return sorted(
            {value for record in records if (value := number_at(record.attributes, key)) is not None}
        )

    return [
        (
            "vision",
            "views, each with its own light",
            counts("vision.training_views"),
            counts("vision.held_out_views"),
        ),
        ("audio", "surface points", counts("audio.training_points"), counts("audio.held_out_points")),
        ("touch", "touches", counts("touch.training_touches"), counts("touch.held_out_touches")),
    ]


def mean(values: Sequence[float | None]) -> float | None:
    """Return the mean of the values that are there, None where none is."""
    known = [value for value in values if value is not None]
    return statistics.fmean(known) if known else None
