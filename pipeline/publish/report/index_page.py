"""The first page of a report: all objects in a table, and what is known of them together."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from markupsafe import Markup

from pipeline.dataset.failures import FailedObject
from pipeline.dataset.measures import (
    CONTACT,
    FOREGROUND,
    FULL_IMAGE,
    GAIN,
    HEADLINE,
    SENSES,
    SIMILARITY,
    Measure,
    number_at,
)
from pipeline.publish.report.charts import histogram, setting_medians, speed_error_chart
from pipeline.publish.report.measured_objects import MeasuredObject, worst_first
from pipeline.publish.report.object_page import OBJECTS, SENSE_NAMES, page_name
from pipeline.publish.report.summary import (
    MeasureSummary,
    cost_summary,
    definitions_of,
    error_words,
    mean,
    speed_error_rows,
    split,
    stage_rows,
)
from pipeline.publish.report.templates import security_policy, template_environment, web_link

SCRIPTS = ("index.js",)
MOST_SOURCES = 60  # others are found only by the search


class Column(NamedTuple):
    """A column of numbers of the table of objects; its key is where the number stands in the attributes."""

    key: str
    label: str
    unit: str
    decimals: int
    scale: float = 1.0

    @classmethod
    def of(cls, measure: Measure) -> "Column":
        """Return the column of a measure."""
        return cls(measure.key, measure.column, measure.column_unit, measure.decimals)


COLUMNS = (
    Column("margin", "Margin", "dB", 1),
    *map(Column.of, (FOREGROUND, FULL_IMAGE, SIMILARITY, GAIN)),
    Column("audio.modes", "Modes", "", 0),
    Column.of(CONTACT),
    Column("touch.unreachable_share", "Out of reach", "%", 0, 100.0),
    Column("bytes.total", "Object File", "kB", 0, 1e-3),
    Column("cpu_seconds", "Cost", "CPU s", 1),
)


class Row(NamedTuple):
    """An object in the table; `page` is empty for one without, `numbers` are those of `COLUMNS`."""

    object_id: str
    name: str
    page: str = ""
    material: str = ""
    source: str = ""
    status: str = "failed"
    rings: bool = False
    numbers: Sequence[float | None] = (None,) * len(COLUMNS)


def render_index(
    objects: Sequence[MeasuredObject],
    measures: Sequence[MeasureSummary],
    failures: Sequence[FailedObject],
    page_ids: frozenset[str],
    fingerprint: str,
) -> str:
    """Return the first page.

    Parameters
    ----------
    measures
        What is known of all objects together, by measure.
    failures
        All, those of reading products too.
    page_ids
        Ids of the objects that have a page.
    fingerprint
        Of all that the page shows; it carries it.
    """
    sorted_objects = worst_first(objects)
    failed_ids = {failure.object for failure in failures}
    pages = {
        subject.object_id: page_name(subject.object_id)
        for subject in sorted_objects
        if subject.object_id in page_ids
    }
    rows = [_row(subject, failed_ids, pages) for subject in sorted_objects]
    rows += [
        Row(object_id, object_id)
        for object_id in sorted(failed_ids - {subject.object_id for subject in sorted_objects})
    ]
    cost = cost_summary(sorted_objects)
    environment = template_environment()
    environment.filters["error"] = error_words
    return environment.get_template("index.html.j2").render(
        fingerprint=fingerprint,
        policy=security_policy(environment, SCRIPTS),
        records=sorted_objects,
        rows=rows,
        columns=COLUMNS,
        values=json.dumps([row.numbers for row in rows], allow_nan=False, separators=(",", ":")),
        materials=sorted({row.material for row in rows} - {""}, key=str.casefold),
        sources=sorted({row.source for row in rows} - {""}, key=str.casefold)[:MOST_SOURCES],
        statuses=sorted({row.status for row in rows}),
        folder=OBJECTS,
        failures=failures,
        failed=len(failed_ids),
        pages=pages,
        summary=measures,
        figures=[row for row in measures if row.measure in HEADLINE],
        full_image=next(row for row in measures if row.measure == FULL_IMAGE),
        noise_floor_db=mean([number_at(subject.attributes, "vision.noise_floor_db") for subject in objects]),
        ranking=HEADLINE,
        distributions=[(row, *histogram(row)) for row in [*measures, cost] if len(row.values) > 1],
        efforts=_efforts(objects),
        sense_names=SENSE_NAMES,
        stages=stage_rows(objects),
        cost=cost,
        definitions=definitions_of(objects),
        split=split(objects),
    )


def _row(subject: MeasuredObject, failed_ids: set[str], pages: dict[str, str]) -> Row:
    below = subject.margin_db is not None and subject.margin_db < 0
    status = "failed" if subject.object_id in failed_ids else "below target" if below else "made"
    material, source = (subject.description.get(name) for name in ("material", "source"))
    known = {**subject.attributes, "margin": subject.margin_db, "cpu_seconds": subject.cpu_seconds}
    numbers = [_number(known, column, subject.silent) for column in COLUMNS]
    page = pages.get(subject.object_id, "")
    rings = subject.part("audio").get("audible") is True
    words = str(material or ""), _source_group(source), status
    return Row(subject.object_id, subject.name, page, *words, rings, numbers)


def _number(known: Mapping[str, Any], column: Column, silent: bool) -> float | None:
    value = number_at(known, column.key)
    if value is None or (silent and column.key == GAIN.key):
        return None
    return float(f"{value * column.scale:.7g}")


def _source_group(source: Any) -> str:
    """Return what objects are filtered by: the host of an address, else the words of the source."""
    address = web_link(source)
    if address is None:
        return str(source or "").strip()
    try:
        return urlsplit(address).hostname or address
    except ValueError:
        return address


def _efforts(objects: Sequence[MeasuredObject]) -> list[tuple[str, list[Markup], list[dict[str, Any]]]]:
    """Return, for each sense, its name, charts of error against effort, and medians by setting."""
    rows = speed_error_rows(objects)
    efforts = []
    for sense in SENSES:
        own = [row for row in rows if row["sense"] == sense]
        title = SENSE_NAMES[sense]
        charts_drawn = [speed_error_chart(title, own, column) for column in ("seconds_per_query", "bytes")]
        efforts.append((title, [chart for chart in charts_drawn if chart], setting_medians(own)))
    return efforts
