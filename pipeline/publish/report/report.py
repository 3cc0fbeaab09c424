"""The report of a data set: metrics, tables, pages and cards on the fidelity of Object Files.

Everything is a function of the products and the cost table: no time, host or path gets in.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from markupsafe import Markup

from objectfolder.products.atomic import write_whole
from objectfolder.products.provenance import canonical_json
from pipeline.dataset.failures import FailedObject, read_failures
from pipeline.dataset.job import Runner
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
from pipeline.dataset.products import PLAYERS
from pipeline.dataset.stages import FIDELITY
from pipeline.dataset.verified import Verified, without_collector
from pipeline.publish.data_set import REPORTS, write_cards
from pipeline.publish.report.charts import histogram, setting_medians, speed_error_chart
from pipeline.publish.report.measured_objects import (
    MeasuredObject,
    MeasureSummary,
    cost_summary,
    mean,
    read_objects,
    summaries,
    worst_first,
)
from pipeline.publish.report.object_page import (
    OBJECTS,
    SENSE_NAMES,
    ObjectPage,
    code_digest,
    page_name,
    shown_fingerprint,
)
from pipeline.publish.report.page_files import RunnerFor, write_pages
from pipeline.publish.report.summary import (
    definitions_of,
    error_words,
    metrics_text,
    object_table,
    speed_error_rows,
    speed_error_table,
    split,
    stage_rows,
)
from pipeline.publish.report.templates import security_policy, template_environment, web_link
from pipeline.run.costs import costs_path, read_costs
from pipeline.run.exclusive import exclusive

SCRIPTS = ("index.js",)
MOST_SOURCES = 60  # others are found only by the search
# Pairs that a page shows of each sense, at most: as many as a verification stores.
PAIRS = 4


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


def make_report(root: Path) -> None:
    """Write the tables, the pages and the cards of the data set."""

    def runner_for(pages: int) -> AbstractContextManager[Runner]:
        from pipeline.cluster.cluster import runner
        from pipeline.cluster.places import read_place

        return runner(read_place(root), root, pages)

    fidelity, reports = root / FIDELITY.folder, root / REPORTS
    with exclusive(root, "stage report"):
        states, failures = Verified(root), read_failures(root)
        write_report(fidelity, costs_path(root), reports, failures, runner_for=runner_for, states=states)
        with without_collector():
            write_cards(root, reports, states)
    print(f"Report: {REPORTS}/index.html")


def write_report(
    fidelity_folder: Path,
    costs_csv: Path,
    reports_folder: Path,
    failures: Iterable[FailedObject] = (),
    *,
    pairs: int = PAIRS,
    runner_for: RunnerFor | None = None,
    states: Verified | None = None,
) -> None:
    """Write metrics.json, per_object.csv, speed_error.csv, index.html and a page an object in ``objects/``.

    Pages that show what is known are kept as they are; those of objects that are gone are
    removed. The other products of an object are looked for beside `fidelity_folder`.

    Parameters
    ----------
    fidelity_folder
        Fidelity products, ``<id>.zarr.zip``; an unreadable one is reported as a failure.
    costs_csv
        Table of costs (see `pipeline.run.costs.read_costs`); may be absent.
    reports_folder
        Made where it is missing.
    failures
        What the run before could not make.
    pairs
        Held-out queries of each sense that a page shows, at most.
    runner_for
        Who draws pages where many changed (see `pipeline.publish.report.page_files.draw_pages`).
    states
        What is known of products; read from beside `reports_folder` if it is not given.

    Raises
    ------
    InputError
        A cost table that is not one.
    """
    objects, unreadable = read_objects(fidelity_folder, read_costs(costs_csv))
    all_failures = sorted(
        [*failures, *unreadable], key=lambda subject: (subject.object, subject.stage, subject.error)
    )
    own: dict[str, list[FailedObject]] = {}
    for failure in all_failures:
        own.setdefault(failure.object, []).append(failure)
    ids = ["", *(subject.object_id for subject in objects), ""]
    data, states = fidelity_folder.parent, states or Verified(reports_folder.parent)
    pages = [
        ObjectPage(subject, data, ids[place], ids[place + 2], own.get(subject.object_id, ()), pairs, states)
        for place, subject in enumerate(objects)
    ]
    page_ids, faults = write_pages(
        pages, reports_folder / OBJECTS, reports_folder.parent / PLAYERS, runner_for
    )
    states.save()
    all_failures += faults
    measures = summaries(worst_first(objects))
    texts = {
        "metrics.json": metrics_text(
            [(row.measure, row.mean, row.worst) for row in measures],
            len(objects),
            len({failure.object for failure in all_failures}),
            sum(subject.silent for subject in objects),
        ),
        "per_object.csv": object_table(objects),
        "speed_error.csv": speed_error_table(objects),
    }
    content = canonical_json(
        [code_digest(), [page.fingerprint for page in pages], list(map(repr, all_failures))]
    )
    fingerprint = hashlib.sha256(content.encode()).hexdigest()
    # What the first page shows of an object whose own page failed is in no fingerprint.
    if faults or shown_fingerprint(reports_folder / "index.html")[0] != fingerprint:
        texts["index.html"] = _render_index(objects, measures, all_failures, page_ids, fingerprint)
    for name, text in texts.items():
        write_whole(reports_folder / name, text)


@without_collector()
def _render_index(
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
    figures = {**subject.attributes, "margin": subject.margin_db, "cpu_seconds": subject.cpu_seconds}
    numbers = [_number(figures, column, subject.silent) for column in COLUMNS]
    page = pages.get(subject.object_id, "")
    rings = subject.part("audio").get("audible") is True
    words = str(material or ""), _source_group(source), status
    return Row(subject.object_id, subject.name, page, *words, rings, numbers)


def _number(figures: Mapping[str, Any], column: Column, silent: bool) -> float | None:
    value = number_at(figures, column.key)
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
