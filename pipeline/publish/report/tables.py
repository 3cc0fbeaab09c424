"""The tables beside the page: metrics.json, per_object.csv and speed_error.csv."""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pipeline.dataset.failures import FailedObject
from pipeline.dataset.measures import BYTE_PARTS, HEADLINE, SENSES, number_at
from pipeline.publish.report.measured_objects import MeasuredObject, stage_names
from pipeline.publish.report.summary import MeasureSummary

PARTS = ("body", *SENSES, "bytes")


def metrics_text(
    summaries: Sequence[MeasureSummary], objects: Sequence[MeasuredObject], failures: Sequence[FailedObject]
) -> str:
    """Return mean and worst of each measure over the objects that have it, as JSON, one key a line.

    Silent objects leave the means of audio and are counted instead; a measure that no object has is
    null. `failed` counts objects, not failures.
    """
    table: dict[str, Any] = {
        "objects": len(objects),
        "failed": len({failure.object for failure in failures}),
        "audio": {"silent_objects": sum(one.silent for one in objects)},
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
    stated = [(one, part, name) for one in objects for part in PARTS[:-1] for name in one.part(part)]
    keys = {(part, name) for one, part, name in stated if number_at(one.part(part), name) is not None}
    keys |= {(measure.sense, measure.name) for measure in HEADLINE}
    ordered = sorted(keys, key=lambda key: (PARTS.index(key[0]), key[1]))
    ordered += [("bytes", name) for name in BYTE_PARTS]
    stages = stage_names(objects)
    rows = []
    for one in objects:
        row: dict[str, Any] = {
            "id": one.object_id,
            "name": one.name,
            "material": str(one.description.get("material") or ""),
            "audio.audible": "" if "audible" not in one.part("audio") else int(not one.silent),
        }
        row |= {f"{part}.{name}": number_at(one.part(part), name) for part, name in ordered}
        for stage in stages:
            cost = one.cost(stage)
            row[f"cpu_seconds.{stage}"] = cost.cpu_s if cost else None
        rows.append(row)
    columns = ["id", "name", "material", "audio.audible", *(".".join(key) for key in ordered)]
    return _csv([*columns, *(f"cpu_seconds.{stage}" for stage in stages)], rows)


def speed_error_rows(objects: Sequence[MeasuredObject]) -> list[dict[str, Any]]:
    """Return one row an object, sense and setting, settings in the order of the product."""
    order = {sense: index for index, sense in enumerate(SENSES)}
    return [
        row
        for one in objects
        for row in sorted(one.efforts, key=lambda row: (order.get(row["sense"], len(order)), row["sense"]))
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
