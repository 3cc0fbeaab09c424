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
    paged: frozenset[str],
    fingerprint: str,
) -> str:
    """Return the first page.

    Parameters
    ----------
    measures
        What is known of all objects together, by measure.
    failures
        All, those of reading products too.
    paged
        Ids of the objects that have a page.
    fingerprint
        Of all that the page shows; it carries it.
    """
    ordered = worst_first(objects)
    failed = {failure.object for failure in failures}
    pages = {one.object_id: page_name(one.object_id) for one in ordered if one.object_id in paged}
    rows = [_row(one, failed, pages) for one in ordered]
    rows += [Row(object_id, object_id) for object_id in sorted(failed - {one.object_id for one in ordered})]
    cost = cost_summary(ordered)
    environment = template_environment()
    environment.filters["error"] = error_words
    return environment.get_template("index.html.j2").render(
        fingerprint=fingerprint,
        policy=security_policy(environment, SCRIPTS),
        records=ordered,
        rows=rows,
        columns=COLUMNS,
        values=json.dumps([row.numbers for row in rows], allow_nan=False, separators=(",", ":")),
        materials=sorted({row.material for row in rows} - {""}, key=str.casefold),
        sources=sorted({row.source for row in rows} - {""}, key=str.casefold)[:MOST_SOURCES],
        statuses=sorted({row.status for row in rows}),
        folder=OBJECTS,
        failures=failures,
        failed=len(failed),
        pages=pages,
        summary=measures,
        figures=[row for row in measures if row.measure in HEADLINE],
        full_image=next(row for row in measures if row.measure == FULL_IMAGE),
        noise_floor_db=mean([number_at(one.attributes, "vision.noise_floor_db") for one in objects]),
        ranking=HEADLINE,
        distributions=[(row, *histogram(row)) for row in [*measures, cost] if len(row.values) > 1],
        efforts=_efforts(objects),
        sense_names=SENSE_NAMES,
        stages=stage_rows(objects),
        cost=cost,
        definitions=definitions_of(objects),
        split=split(objects),
    )


def _row(one: MeasuredObject, failed: set[str], pages: dict[str, str]) -> Row:
    below = one.margin_db is not None and one.margin_db < 0
    status = "failed" if one.object_id in failed else "below target" if below else "made"
    material, source = (one.description.get(name) for name in ("material", "source"))
    known = {**one.attributes, "margin": one.margin_db, "cpu_seconds": one.cpu_seconds}
    numbers = [_number(known, column, one.silent) for column in COLUMNS]
    page = pages.get(one.object_id, "")
    rings = one.part("audio").get("audible") is True
    words = str(material or ""), _source_group(source), status
    return Row(one.object_id, one.name, page, *words, rings, numbers)


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
        drawn = [speed_error_chart(title, own, column) for column in ("seconds_per_query", "bytes")]
        efforts.append((title, [chart for chart in drawn if chart], setting_medians(own)))
    return efforts
