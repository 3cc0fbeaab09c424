"""Metrics, tables and pages on the fidelity of Object Files.

Everything is a function of the products and the cost table: no time, host or path gets in.
"""

import hashlib
from collections.abc import Iterable
from pathlib import Path

from objectfolder.products.atomic import write_whole
from objectfolder.products.provenance import canonical_json
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.products import PLAYERS
from pipeline.dataset.task import Failure
from pipeline.dataset.verified import Verified
from pipeline.publish.report.index_page import render_index
from pipeline.publish.report.measured_objects import read_objects, worst_first
from pipeline.publish.report.object_page import (
    OBJECTS,
    PLAYER,
    ObjectPage,
    code_digest,
    page_name,
    shown_fingerprint,
)
from pipeline.publish.report.page_files import RunnerFor, draw_pages
from pipeline.publish.report.summary import metrics_text, object_table, speed_error_table, summaries
from pipeline.run.costs import read_costs

# Pairs that a page shows of each sense, at most: as many as a verification stores.
PAIRS = 4


def write_report(
    fidelity_folder: Path,
    costs_csv: Path,
    reports_folder: Path,
    failures: Iterable[FailedObject] = (),
    *,
    pairs: int = PAIRS,
    runner_for: RunnerFor | None = None,
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
    data, states = fidelity_folder.parent, Verified(reports_folder.parent)
    pages = [
        ObjectPage(subject, data, ids[place], ids[place + 2], own.get(subject.object_id, ()), pairs, states)
        for place, subject in enumerate(objects)
    ]
    page_ids, faults = _write_pages(
        pages, reports_folder / OBJECTS, reports_folder.parent / PLAYERS, runner_for
    )
    states.save()
    all_failures += faults
    measures = summaries(worst_first(objects))
    texts = {
        "metrics.json": metrics_text(
            measures,
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
        texts["index.html"] = render_index(objects, measures, all_failures, page_ids, fingerprint)
    for name, text in texts.items():
        write_whole(reports_folder / name, text)


def _write_pages(
    pages: Iterable[ObjectPage], folder: Path, cache: Path, runner_for: RunnerFor | None
) -> tuple[frozenset[str], list[FailedObject]]:
    """Write the files of pages, and remove others; return ids with a page, and why others have none."""
    page_ids, faults = set(), []
    file_names: set[str] = set()
    stale = []
    present = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    for page in pages:
        if names := _current_files(page, folder, present):
            file_names |= names
            page_ids.add(page.subject.object_id)
        else:
            stale.append(page)
    for page, files in draw_pages(stale, cache, runner_for):
        object_id = page.subject.object_id
        if isinstance(files, Failure):
            finding = f"{page.subject.stored_name}: {files.error}"
            faults.append(FailedObject(object_id, "report", finding, files.remedy))
            continue
        folder.mkdir(parents=True, exist_ok=True)
        *beside, (name, text) = files.items()
        for name_beside, content in beside:
            (folder / name_beside).write_bytes(content)
        write_whole(folder / name, text)  # the page, written last, says that all is there
        file_names |= files.keys()
        page_ids.add(object_id)
    if any(name.endswith(PLAYER) for name in file_names):
        from pipeline.publish.viewer.static import write_player_assets

        file_names |= write_player_assets(folder)
    for path in folder.iterdir() if folder.is_dir() else []:
        if path.name not in file_names and path.is_file():
            path.unlink()
    faults.sort(key=lambda failure: failure.object)
    return frozenset(page_ids), faults


def _current_files(page: ObjectPage, folder: Path, present: set[str]) -> set[str]:
    """Return the names of the files of a page, if all are `present` and show what is known; else none."""
    path = folder / page_name(page.subject.object_id)
    page_fingerprint, has_player = shown_fingerprint(path)
    if page_fingerprint != page.fingerprint:
        return set()
    names = {path.name, *map(page.beside, page.tile), *([page.player] if has_player else [])}
    return names if names <= present else set()
