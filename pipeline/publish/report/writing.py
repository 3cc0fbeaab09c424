"""Metrics, tables and pages of what the Object Files are worth.

Everything is a function of the products and the cost table: no time, host or path gets in.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from objectfolder.atomic import atomic_write
from pipeline.dataset.state import PLAYERS
from pipeline.publish.report.costs import costs_by_object
from pipeline.publish.report.index_page import OBJECTS, render_index
from pipeline.publish.report.object_records import Failure, read_failures, read_records
from pipeline.publish.report.pages import PAIRS, write_pages
from pipeline.publish.report.stored_products import Shelf
from pipeline.publish.report.tables import (
    SPEED_ERROR_COLUMNS,
    csv_text,
    metrics,
    metrics_text,
    object_columns,
    object_rows,
    speed_error_rows,
)

__all__ = ["write_report"]

RESULTS = "bench/results"


def write_report(
    fidelity_folder: Path,
    costs_csv: Path,
    reports_folder: Path,
    failures: Sequence[Mapping[str, Any]] = (),
    *,
    results: Path | None = None,
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
        Mappings with object, stage, error and remedy.
    results
        Folder with results of comparisons; ``bench/results`` beside `reports_folder` by default.
    pairs
        Held-out queries of each sense that a page shows, at most.

    Raises
    ------
    InputError
        A cost table that is not one.
    """
    fidelity_folder, reports_folder = Path(fidelity_folder), Path(reports_folder)
    records, unreadable = read_records(fidelity_folder)
    costs = costs_by_object(Path(costs_csv))
    known = [*read_failures(failures), *unreadable]
    own: dict[str, list[Failure]] = {}
    for failure in known:
        own.setdefault(failure.object_id, []).append(failure)
    shelf = Shelf(fidelity_folder.parent)
    cache = reports_folder.parent / PLAYERS
    pages = write_pages(records, shelf, costs, own, reports_folder / OBJECTS, pairs, cache)
    every = [*known, *pages.damaged]
    paged = frozenset([*pages.made, *pages.kept])
    results = reports_folder.parent / RESULTS if results is None else results
    texts = {
        "metrics.json": metrics_text(metrics(records, every)),
        "per_object.csv": csv_text(object_columns(records, costs), object_rows(records, costs)),
        "speed_error.csv": csv_text(SPEED_ERROR_COLUMNS, speed_error_rows(records, costs)),
        "index.html": render_index(records, every, costs, results, paged),
    }
    for name, text in texts.items():
        with atomic_write(reports_folder / name) as file:
            file.write(text.encode())
