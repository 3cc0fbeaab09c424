"""The tables beside the page: metrics.json, per_object.csv and speed_error.csv."""

import csv
import io
import json
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.dataset.measures import (
    BYTE_PARTS,
    BYTES,
    HEADLINE,
    OBJECT_NUMBERS,
    SENSES,
    Measure,
    number_at,
)
from pipeline.publish.report.costs import Costs
from pipeline.publish.report.object_records import Failure, Record

SPEED_ERROR_COLUMNS = (
    "object",
    "sense",
    "setting",
    "value",
    "seconds_per_query",
    "bytes",
    "error",
    "error_unit",
)


def metrics(records: Sequence[Record], failures: Sequence[Failure]) -> dict[str, Any]:
    """Return mean and worst of each headline measure over the objects that have it.

    Silent objects leave the means of audio and are counted instead; a measure that no object has is
    null. `failed` counts objects, not failures.
    """
    table: dict[str, Any] = {
        "objects": len(records),
        "failed": len({failure.object_id for failure in failures}),
    }
    for measure in HEADLINE:
        table.setdefault(measure.sense, {})[measure.name] = _mean_and_worst(measure, records)
    table["audio"]["silent_objects"] = sum(record.silent for record in records)
    table["bytes"] = _mean_and_worst(BYTES, records)
    return table


def metrics_text(table: Mapping[str, Any]) -> str:
    """Return metrics as JSON without NaN, one key a line."""
    return json.dumps(table, indent=2, sort_keys=True, allow_nan=False) + "\n"


def object_rows(records: Sequence[Record], costs: Costs) -> list[dict[str, Any]]:
    """Return one row an object with every number known of it; None where there is none."""
    rows = []
    stages = _stage_names(records, costs)
    for record in records:
        row: dict[str, Any] = {
            "id": record.object_id,
            "name": record.name,
            "material": str(record.description.get("material") or ""),
            "audio.audible": "" if "audible" not in record.sense("audio") else int(not record.silent),
        }
        for sense, names in OBJECT_NUMBERS.items():
            row |= {f"{sense}.{name}": number_at(record.attributes, f"{sense}.{name}") for name in names}
        row |= {f"bytes.{part}": number_at(record.attributes, f"bytes.{part}") for part in BYTE_PARTS}
        for stage in stages:
            cost = costs.stage(record.object_id, stage, record.fingerprints)
            row[f"cpu_seconds.{stage}"] = cost.cpu_s if cost else None
        rows.append(row)
    return rows


def speed_error_rows(records: Sequence[Record], costs: Costs) -> list[dict[str, Any]]:
    """Return one row an object, sense and setting, settings in the order of the product."""
    rows = []
    for record in records:
        entries = sorted(record.speed_error, key=lambda entry: _sense_order(entry.get("sense")))
        for entry in entries:
            rows.append(
                {
                    "object": record.object_id,
                    "sense": str(entry.get("sense") or ""),
                    "setting": str(entry.get("setting") or ""),
                    "value": number_at(entry, "value"),
                    "seconds_per_query": costs.seconds_per_query(
                        record.object_id, str(entry.get("key") or ""), record.fingerprints
                    ),
                    "bytes": number_at(entry, "bytes"),
                    "error": number_at(entry, "error"),
                    "error_unit": str(entry.get("error_unit") or ""),
                }
            )
    return rows


def csv_text(columns: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as CSV, fractions to eight significant digits, nothing where there is no number."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_cell(row[column]) for column in columns])
    return buffer.getvalue()


def object_columns(records: Sequence[Record], costs: Costs) -> tuple[str, ...]:
    """Return the columns of per_object.csv, also for no object at all."""
    numbers = [f"{sense}.{name}" for sense, names in OBJECT_NUMBERS.items() for name in names]
    return (
        "id",
        "name",
        "material",
        "audio.audible",
        *numbers,
        *(f"bytes.{part}" for part in BYTE_PARTS),
        *(f"cpu_seconds.{stage}" for stage in _stage_names(records, costs)),
    )


def _stage_names(records: Sequence[Record], costs: Costs) -> tuple[str, ...]:
    return costs.stage_names({record.object_id for record in records})


def _mean_and_worst(measure: Measure, records: Sequence[Record]) -> dict[str, float | None]:
    values = [
        value
        for record in records
        if (value := measure.of(record.attributes)) is not None
        and not (measure.sense == "audio" and record.silent)
    ]
    if not values:
        return {"mean": None, "worst": None}
    return {"mean": _rounded(statistics.fmean(values)), "worst": _rounded(measure.worst(values))}


def _sense_order(sense: Any) -> tuple[int, str]:
    return (SENSES.index(sense) if sense in SENSES else len(SENSES)), str(sense)


def _rounded(value: float) -> float:
    return float(f"{value:.8g}")


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() else f"{value:.8g}"
    return str(value)
