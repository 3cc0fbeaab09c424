"""Metrics, tables and a page of what the Object Files are worth.

Everything is a function of the fidelity products and the cost table: no time, host or path gets in.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from objectfolder.atomic import atomic_write
from pipeline.report.costs import read_costs
from pipeline.report.page import render_page
from pipeline.report.records import read_failures, read_records
from pipeline.report.tables import (
    SPEED_ERROR_COLUMNS,
    csv_text,
    metrics,
    metrics_text,
    object_columns,
    object_rows,
    speed_error_rows,
)

__all__ = ["write_report"]


def write_report(
    fidelity_folder: Path,
    costs_csv: Path,
    reports_folder: Path,
    failures: Sequence[Mapping[str, Any]] = (),
) -> None:
    """Write metrics.json, per_object.csv, speed_error.csv and index.html, each atomically.

    Parameters
    ----------
    fidelity_folder
        Fidelity products, ``<id>.zarr.zip``; an unreadable one is reported as a failure.
    costs_csv
        Table of costs (see `costs.read_costs`); may be absent.
    reports_folder
        Made where it is missing.
    failures
        Mappings with object, stage, error and remedy.

    Raises
    ------
    InputError
        A cost table that is not one.
    """
    records, unreadable = read_records(Path(fidelity_folder))
    costs = read_costs(Path(costs_csv))
    known = [*read_failures(failures), *unreadable]
    page, damaged = render_page(records, known, costs)
    texts = {
        "metrics.json": metrics_text(metrics(records, [*known, *damaged])),
        "per_object.csv": csv_text(object_columns(records, costs), object_rows(records, costs)),
        "speed_error.csv": csv_text(SPEED_ERROR_COLUMNS, speed_error_rows(records, costs)),
        "index.html": page,
    }
    for name, text in texts.items():
        with atomic_write(Path(reports_folder) / name) as file:
            file.write(text.encode())
