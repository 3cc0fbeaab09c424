"""The data set in a few rows, and its tables: metrics.json, per_object.csv and speed_error.csv."""

import csv
import io
import json
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pipeline.dataset.measures import BYTE_PARTS, REPORTED, SENSES, Measure, number_at
from pipeline.publish.report.measured_objects import MeasuredObject, stage_names

# What settings and errors of a fidelity product are called here; of others the names stand as they are.
SETTINGS = {"sub_rays": "@ rays a pixel", "modes": "@ modes", "surface_step_um": "surface to @ µm"}
ERRORS = {
    "PSNR dB": "likeness of views, dB (more is better)",
    "contact PSNR dB": "likeness of contacts, dB (more is better)",
    "STFT distance dB": "difference of sounds, dB (less is better)",
}


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


PARTS = ("body", *SENSES, "bytes")


def metrics_text(
    figures: Iterable[tuple[Measure, float | None, float | None]],
    objects: int,
    failure_count: int,
    silent: int,
) -> str:
    """Return measures with mean and worst over the objects that have them, as JSON, one key a line.

    Silent objects leave the means of audio and are counted instead; a measure that no object has is
    null. `objects`, `failure_count` and `silent` count objects.
    """
    table: dict[str, Any] = {
        "objects": objects,
        "failed": failure_count,
        "audio": {"silent_objects": silent},
    }
    for measure, mean, worst in figures:
        numbers = {"mean": _rounded(mean), "worst": _rounded(worst)}
        if measure.sense == "bytes":
            table["bytes"] = numbers
        else:
            table.setdefault(measure.sense, {})[measure.name] = numbers
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
