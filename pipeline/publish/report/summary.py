"""The data set in a few rows, and its tables: metrics.json, per_object.csv and speed_error.csv."""

import csv
import io
import json
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from pipeline.dataset.measures import BYTE_PARTS, BYTES, REPORTED, SENSES, Measure, number_at
from pipeline.publish.report.measured_objects import MeasuredObject, stage_names

COST = Measure("cpu_seconds", "Cost, mesh to verified file", "CPU s", 0, False, 240.0)

# What settings and errors of a fidelity product are called here; of others the names stand as they are.
SETTINGS = {"sub_rays": "@ rays a pixel", "modes": "@ modes", "surface_step_um": "surface to @ µm"}
ERRORS = {
    "PSNR dB": "likeness of views, dB (more is better)",
    "contact PSNR dB": "likeness of contacts, dB (more is better)",
    "STFT distance dB": "difference of sounds, dB (less is better)",
}


@dataclass(frozen=True)
class MeasureSummary:
    """A measure over the objects that have it; all numbers are None where none has.

    Parameters
    ----------
    values
        Value and id of each object.
    trivial
        Mean score of the trivial answer.
    noise_floor
        Mean of the best scores that the noise of the truth allows.
    """

    measure: Measure
    values: Sequence[tuple[float, str]]
    trivial: float | None = None
    noise_floor: float | None = None

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
        worst = self.worst
        return next((object_id for value, object_id in self.values if value == worst), "")

    @property
    def met(self) -> bool | None:
        """Whether the mean reaches the target; None where there is no target or no mean."""
        if self.mean is None or self.measure.target is None:
            return None
        return self.measure.margin(self.mean) >= 0


def summaries(objects: Sequence[MeasuredObject]) -> list[MeasureSummary]:
    """Return every headline measure and the bytes; silent objects leave those of audio.

    An occasional measure that no object has is left out.
    """
    results = []
    for measure in (*REPORTED, BYTES):
        subjects = [subject for subject in objects if not (measure.sense == "audio" and subject.silent)]
        present = [
            (value, subject) for subject in subjects if (value := measure.of(subject.attributes)) is not None
        ]
        if measure.occasional and not present:
            continue
        trivial = mean([measure.trivial_of(subject.attributes) for _, subject in present])
        floor = mean([measure.noise_floor_of(subject.attributes) for _, subject in present])
        values = [(value, subject.object_id) for value, subject in present]
        results.append(MeasureSummary(measure, values, trivial, floor))
    return results


def cost_summary(objects: Sequence[MeasuredObject]) -> MeasureSummary:
    """Return the cost of the objects whose every stage was measured."""
    seconds = [(subject.cpu_seconds, subject.object_id) for subject in objects]
    return MeasureSummary(COST, [(value, object_id) for value, object_id in seconds if value is not None])


def stage_rows(objects: Sequence[MeasuredObject]) -> list[dict[str, Any]]:
    """Return CPU seconds and peak memory of each stage over the objects it was measured for."""
    rows = []
    for stage in stage_names(objects):
        costs = [cost for subject in objects if (cost := subject.cost(stage))]
        cpu = [cost.cpu_s for cost in costs if cost.cpu_s is not None]
        memory = [cost.peak_memory_mb for cost in costs if cost.peak_memory_mb is not None]
        row = {"stage": stage, "objects": len(cpu), "median": statistics.median(cpu) if cpu else None}
        rows.append({**row, "largest": max(cpu, default=None), "peak_memory_mb": max(memory, default=None)})
    return rows


def definitions_of(objects: Sequence[MeasuredObject]) -> dict[str, str]:
    """Return measure to definition: the products' own words in their order."""
    own: dict[str, str] = {}
    for subject in objects:
        own |= {str(name): str(text) for name, text in subject.part("definitions").items()}
    return own


def split(objects: Sequence[MeasuredObject]) -> list[tuple[str, str, list[float], list[float]]]:
    """Return sense, unit, and the distinct counts of training and of held-out queries."""

    def counts(key: str) -> list[float]:
        return sorted(
            {value for subject in objects if (value := number_at(subject.attributes, key)) is not None}
        )

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
    present = [value for value in values if value is not None]
    return statistics.fmean(present) if present else None


PARTS = ("body", *SENSES, "bytes")


class MeanAndWorst(Protocol):
    """A measure over objects; None where none has it."""

    @property
    def measure(self) -> Measure:
        """What is measured."""

    @property
    def mean(self) -> float | None:
        """Mean over the objects."""

    @property
    def worst(self) -> float | None:
        """Worst of the objects."""


def metrics_text(summaries: Sequence[MeanAndWorst], objects: int, failure_count: int, silent: int) -> str:
    """Return mean and worst of each measure over the objects that have it, as JSON, one key a line.

    Silent objects leave the means of audio and are counted instead; a measure that no object has is
    null. `objects`, `failure_count` and `silent` count objects.
    """
    table: dict[str, Any] = {
        "objects": objects,
        "failed": failure_count,
        "audio": {"silent_objects": silent},
    }
    for summary in summaries:
        numbers = {"mean": _rounded(summary.mean), "worst": _rounded(summary.worst)}
        if summary.measure.sense == "bytes":
            table["bytes"] = numbers
        else:
            table.setdefault(summary.measure.sense, {})[summary.measure.name] = numbers
    return json.dumps(table, indent=2, sort_keys=True, allow_nan=False) + "\n"


def object_table(objects: Sequence[MeasuredObject]) -> str:
    """Return one row an object with every number known of it; an empty cell for an unknown one."""
    keys_there = [
        (subject, part, name) for subject in objects for part in PARTS[:-1] for name in subject.part(part)
    ]
    keys = {
        (part, name) for subject, part, name in keys_there if number_at(subject.part(part), name) is not None
    }
    keys |= {(measure.sense, measure.name) for measure in REPORTED if not measure.occasional}
    columns_in_order = sorted(keys, key=lambda key: (PARTS.index(key[0]), key[1]))
    columns_in_order += [("bytes", name) for name in BYTE_PARTS]
    stages = stage_names(objects)
    rows = []
    for subject in objects:
        row: dict[str, Any] = {
            "id": subject.object_id,
            "name": subject.name,
            "material": str(subject.description.get("material") or ""),
            "audio.audible": "" if "audible" not in subject.part("audio") else int(not subject.silent),
        }
        row |= {f"{part}.{name}": number_at(subject.part(part), name) for part, name in columns_in_order}
        for stage in stages:
            cost = subject.cost(stage)
            row[f"cpu_seconds.{stage}"] = cost.cpu_s if cost else None
        rows.append(row)
    columns = ["id", "name", "material", "audio.audible", *(".".join(key) for key in columns_in_order)]
    return _csv([*columns, *(f"cpu_seconds.{stage}" for stage in stages)], rows)


def speed_error_rows(objects: Sequence[MeasuredObject]) -> list[dict[str, Any]]:
    """Return one row an object, sense and setting, settings in the order of the product."""
    order = {sense: index for index, sense in enumerate(SENSES)}
    return [
        row
        for subject in objects
        for row in sorted(
            subject.efforts, key=lambda row: (order.get(row["sense"], len(order)), row["sense"])
        )
    ]


def speed_error_table(objects: Sequence[MeasuredObject]) -> str:
    """Return the rows of `speed_error_rows` as CSV."""
    columns = ("object", "sense", "setting", "value", "seconds_per_query", "bytes", "error", "error_unit")
    return _csv(columns, speed_error_rows(objects))


def _csv(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Return rows as CSV, fractions to eight significant digits, nothing where there is no number."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in rows)
    return buffer.getvalue()


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.8g}")


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return int(value) if value.is_integer() else f"{value:.8g}"
    return value


def setting_words(setting: str, low: float | None, high: float | None) -> str:
    """Return a setting in a reader's words, with the range of its values."""
    name = setting.replace("_", " ")
    if low is None or high is None or math.isnan(low):
        return name
    span = f"{low:g}" + (f" to {high:g}" if high > low else "")
    return SETTINGS.get(setting, f"{name} @").replace("@", span)


def error_words(unit: str) -> str:
    """Return in a reader's words what an error of this unit measures."""
    return ERRORS.get(unit, unit)
