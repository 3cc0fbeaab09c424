"""The first page of a report: all objects in a table, and what is known of them together."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from pipeline.dataset.measures import BYTES, HEADLINE, RANKING, SENSES, number_at
from pipeline.publish.report import formats
from pipeline.publish.report.charts import Chart, setting_medians, speed_error_chart
from pipeline.publish.report.costs import Costs
from pipeline.publish.report.distributions import Distribution, distribution, measure_distribution
from pipeline.publish.report.object_page import SENSE_NAMES, page_name
from pipeline.publish.report.object_records import Failure, Record, worst_first
from pipeline.publish.report.rivals import rival_charts
from pipeline.publish.report.summary import (
    definitions_of,
    mean,
    split,
    stage_rows,
    summary_row,
    total_cpu_seconds,
)
from pipeline.publish.report.tables import speed_error_rows
from pipeline.publish.report.templates import security_policy, template_environment

SCRIPTS = ("theme.js", "index.js")
OBJECTS = "objects"
TARGET_CPU_SECONDS = 240.0
# Sources beyond so many are found by the search alone.
MOST_SOURCES = 60


@dataclass(frozen=True)
class Column:
    """A column of numbers of the table of objects; its key is where the number stands in the attributes."""

    key: str
    label: str
    unit: str
    decimals: int


COLUMNS = (
    Column("margin", "Margin", "dB", 1),
    Column("vision.psnr_foreground_db", "View, foreground", "dB", 1),
    Column("vision.psnr_db", "View", "dB", 1),
    Column("vision.ssim", "View", "SSIM", 4),
    Column("audio.gain_error_db", "Gain error", "dB", 1),
    Column("audio.modes", "Modes", "", 0),
    Column("touch.psnr_contact_db", "Touch, contact", "dB", 1),
    Column("touch.unreachable_share", "Out of reach", "%", 0),
    Column("bytes.total", "Object File", "kB", 0),
    Column("cpu_seconds", "Cost", "CPU s", 1),
)
SCALES = {"touch.unreachable_share": 100.0, "bytes.total": 1e-3}


@dataclass(frozen=True)
class Row:
    """An object in the table.

    Parameters
    ----------
    page
        Name of its page; empty for an object without one.
    status
        ``made``, ``below target`` (some margin is negative) or ``failed``.
    cells
        Numbers as printed, in the order of `COLUMNS`.
    """

    object_id: str
    name: str
    page: str
    material: str
    source: str
    status: str
    cells: list[str]


@dataclass(frozen=True)
class Effort:
    """What more or less effort of a sense costs and gives."""

    sense: str
    charts: list[Chart]
    medians: list[dict[str, Any]]


def render_index(
    records: Sequence[Record],
    failures: Sequence[Failure],
    costs: Costs,
    results: Path,
    paged: frozenset[str],
) -> str:
    """Return the first page.

    Parameters
    ----------
    failures
        All, those of reading products too.
    results
        Folder of results of comparisons; may be absent.
    paged
        Ids of the objects that have a page.
    """
    ordered = worst_first(records)
    failed = {failure.object_id for failure in failures}
    seconds = {record.object_id: total_cpu_seconds(record, costs) for record in records}
    numbers = [_numbers(record, seconds[record.object_id]) for record in ordered]
    rows = [_row(record, values, failed, paged) for record, values in zip(ordered, numbers, strict=True)]
    for object_id in sorted(failed - {record.object_id for record in records}):
        rows.append(Row(object_id, object_id, "", "", "", "failed", [formats.NOTHING] * len(COLUMNS)))
        numbers.append([None] * len(COLUMNS))
    environment = template_environment()
    return environment.get_template("index.html.j2").render(
        policy=security_policy(environment, SCRIPTS),
        records=ordered,
        rows=rows,
        columns=COLUMNS,
        values=json.dumps(numbers, allow_nan=False, separators=(",", ":")),
        materials=sorted({row.material for row in rows} - {""}, key=str.casefold),
        sources=sorted({row.source for row in rows} - {""}, key=str.casefold)[:MOST_SOURCES],
        statuses=sorted({row.status for row in rows}),
        folder=OBJECTS,
        failures=failures,
        failed=len(failed),
        pages={
            record.object_id: page_name(record.object_id) for record in records if record.object_id in paged
        },
        summary=[summary_row(measure, ordered) for measure in (*HEADLINE, BYTES)],
        noise_floor_db=mean([number_at(record.attributes, "vision.noise_floor_db") for record in records]),
        silent=sum(record.silent for record in records),
        ranking=RANKING,
        distributions=_distributions(ordered, seconds),
        efforts=_efforts(records, costs),
        rivals=rival_charts(results),
        sense_names=SENSE_NAMES,
        stages=stage_rows(records, costs),
        cost=_cost(seconds),
        target_cpu_seconds=TARGET_CPU_SECONDS,
        definitions=definitions_of(records),
        split=split(records),
    )


def source_group(source: Any) -> str:
    """Return what objects are filtered by: the host of an address, else the words of the source."""
    address = formats.web_link(source)
    if address is None:
        return str(source or "").strip()
    try:
        return urlsplit(address).hostname or address
    except ValueError:
        return address


def _numbers(record: Record, cpu_seconds: float | None) -> list[float | None]:
    found: list[float | None] = []
    for column in COLUMNS:
        if column.key == "margin":
            value = record.margin_db
        elif column.key == "cpu_seconds":
            value = cpu_seconds
        else:
            value = number_at(record.attributes, column.key)
            silent = record.silent and column.key == "audio.gain_error_db"
            value = None if value is None or silent else value * SCALES.get(column.key, 1.0)
        found.append(None if value is None else float(f"{value:.7g}"))
    return found


def _row(record: Record, numbers: Sequence[float | None], failed: set[str], paged: frozenset[str]) -> Row:
    below = record.margin_db is not None and record.margin_db < 0
    status = "failed" if record.object_id in failed else "below target" if below else "made"
    return Row(
        record.object_id,
        record.name,
        page_name(record.object_id) if record.object_id in paged else "",
        str(record.description.get("material") or ""),
        source_group(record.description.get("source")),
        status,
        [formats.number(value, column.decimals) for value, column in zip(numbers, COLUMNS, strict=True)],
    )


def _distributions(records: Sequence[Record], seconds: Mapping[str, float | None]) -> list[Distribution]:
    drawn = [measure_distribution(measure, records) for measure in (*HEADLINE, BYTES)]
    known = [(value, object_id) for object_id, value in seconds.items() if value is not None]
    if known:
        worst, worst_object = max(known)
        drawn.append(
            distribution(
                "Cost, mesh to verified file",
                "CPU s",
                [value for value, _ in known],
                lambda value: formats.number(value, 0),
                worst,
                worst_object,
                TARGET_CPU_SECONDS,
            )
        )
    return [each for each in drawn if each is not None]


def _cost(seconds: Mapping[str, float | None]) -> tuple[int, float] | None:
    """Return for how many objects the whole cost is known, and their median; None for none."""
    known = sorted(value for value in seconds.values() if value is not None)
    if not known:
        return None
    half = len(known) // 2
    return len(known), known[half] if len(known) % 2 else (known[half] + known[half - 1]) / 2


def _efforts(records: Sequence[Record], costs: Costs) -> list[Effort]:
    rows = speed_error_rows(records, costs)
    efforts = []
    for sense in SENSES:
        of_sense = [row for row in rows if row["sense"] == sense]
        drawn = [speed_error_chart(of_sense, column) for column in ("seconds_per_query", "bytes")]
        efforts.append(Effort(sense, [chart for chart in drawn if chart], setting_medians(of_sense)))
    return efforts
