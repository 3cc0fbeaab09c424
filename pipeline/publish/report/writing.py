"""Metrics, tables and pages on the fidelity of Object Files.

Everything is a function of the products and the cost table: no time, host or path gets in.
"""

from collections.abc import Iterable
from pathlib import Path

from objectfolder.atomic import atomic_write
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.state import PLAYERS
from pipeline.publish.report.index_page import OBJECTS, render_index
from pipeline.publish.report.measured_objects import read_objects
from pipeline.publish.report.pages import PAIRS, write_pages
from pipeline.publish.report.summary import summaries
from pipeline.publish.report.tables import (
    SPEED_ERROR_COLUMNS,
    csv_text,
    metrics_text,
    object_table,
    speed_error_rows,
)
from pipeline.run.costs import read_costs


def write_report(
    fidelity_folder: Path,
    costs_csv: Path,
    reports_folder: Path,
    failures: Iterable[FailedObject] = (),
    *,
    pairs: int = PAIRS,
) -> None:
    """Write metrics.json, per_object.csv, speed_error.csv, index.html and a page an object in ``objects/``.

    Pages of objects that show what is known are kept as they are; those of objects that are gone are
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

    Raises
    ------
    InputError
        A cost table that is not one.
    """
    objects, unreadable = read_objects(fidelity_folder, read_costs(costs_csv))
    known = sorted([*failures, *unreadable], key=lambda one: (one.object, one.stage, one.error))
    own: dict[str, list[FailedObject]] = {}
    for failure in known:
        own.setdefault(failure.object, []).append(failure)
    paged, damaged = write_pages(
        objects, fidelity_folder.parent, own, reports_folder / OBJECTS, pairs, reports_folder.parent / PLAYERS
    )
    known += damaged
    texts = {
        "metrics.json": metrics_text(summaries(objects), objects, known),
        "per_object.csv": object_table(objects),
        "speed_error.csv": csv_text(SPEED_ERROR_COLUMNS, speed_error_rows(objects)),
        "index.html": render_index(objects, known, paged),
    }
    for name, text in texts.items():
        with atomic_write(reports_folder / name) as file:
            file.write(text.encode())
