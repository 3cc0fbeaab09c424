"""Commands for tables of objects: add, check, fetch."""

import contextlib
import json as json_text
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from objectfolder.errors import InputError, ObjectFolderError
from pipeline.cli.options import Fields, Json, Materials
from pipeline.cli.output_paths import check_new_file
from pipeline.cli.printing import (
    FAILED,
    FINE,
    RESUMED,
    on_interrupt,
    print_error,
    print_text,
    status_line,
    terminal_width,
)
from pipeline.cli.usage import UsageError
from pipeline.dataset.project_files import MATERIALS
from pipeline.intake.add.add_request import AddRequest
from pipeline.intake.sources.fetch_request import Fetching

if TYPE_CHECKING:
    from pipeline.intake.sources.fetching import Fetcher
    from pipeline.intake.sources.registry import Resolutions

AS_USUAL = Fetching()
Several = Parameter(consume_multiple=True)


def add(
    request: Annotated[AddRequest, Fields],
    *,
    table: Path = Path("data/my_objects.csv"),
    replace: bool = False,
    preview: Path | None = None,
    overwrite: bool = False,
    no_preview: bool = False,
    dry_run: bool = False,
    json: Json = False,
) -> None:
    """Check one's own mesh, copy it with what it refers to, and add it to a table of objects.

    Parameters
    ----------
    table
        CSV table, made if absent
    replace
        replace the object of this id
    preview
        the picture (default: beside the object, where it is replaced)
    overwrite
        replace a picture that is there already where --preview names it
    no_preview
        make no picture
    dry_run
        check only; write no row and no copy
    """
    from objectfolder.making.mesh.readers.face_count import refuse_many_faces

    if request.decimate is None:
        refuse_many_faces(request.mesh)  # before what checking it imports: that takes longer
    from pipeline.intake.add.addition import checked_object, put_object
    from pipeline.intake.add.preview import lines_about, preview_of

    if preview and not no_preview:
        check_new_file(preview, overwrite=overwrite)
    with contextlib.ExitStack() as files:
        with status_line(f"checking {request.mesh}"):
            candidate = files.enter_context(checked_object(request))
        lines, figures = lines_about(candidate), candidate.figures()
        if not json:
            print_text("\n".join(lines))
        if not dry_run:
            addition = put_object(candidate, table, replace=replace)
    if not dry_run:
        count = len(candidate.layout.files)
        figures |= {
            "table": str(table),
            "folder": str(addition.folder),
            "files": count,
            "changed": addition.changed,
        }
        verb = "added to" if addition.changed else "is in"
        if not json:
            print_text(
                f"{candidate.object_id} {verb} {table}; {count} file{'s'[: count > 1]} in {addition.folder}"
            )
        preview = preview or addition.folder.parent / f"{candidate.object_id}.png"
    if preview and not no_preview:
        figures["picture"] = str(preview)
        with status_line("drawing a picture"):
            preview_of(candidate, preview, lines)
        if not json:
            print_text(f"picture      {preview}")
    if json:
        print(json_text.dumps(figures, indent=1))
    elif not dry_run:
        print_text(f"next         make dataset OBJECTS={table} ONLY={candidate.object_id}")


def check(
    table: Path,
    *,
    json: Json = False,
    strict: bool = False,
    no_meshes: bool = False,
    materials: Materials = MATERIALS,
) -> int:
    """Find what is wrong or doubtful in a table of objects: units, masses, materials, licences, walls.

    Nothing is changed. The exit status is 1 where there are errors. A doubt that was looked at and stays is
    listed in the column `accepted`, by the name of its rule (length, mass, walls, surface, looks, material,
    licence, provenance, duplicate); the notes say why.

    Parameters
    ----------
    table
        a table of objects (CSV)
    strict
        warnings count as errors
    no_meshes
        look at the table only, at once (a mesh takes a second)
    """
    from pipeline.intake.check.entry import ERROR, WARNING
    from pipeline.intake.check.table_check import as_json, check_table, text

    with status_line(f"checking {table}") as show:
        report = check_table(
            table,
            materials,
            with_meshes=not no_meshes,
            progress=lambda done, rows, object_id: show(f"{done} of {rows}  {object_id}"),
        )
    print_text(as_json(report, table) if json else text(report, table, terminal_width(120)))
    failing = report.count(ERROR) + (report.count(WARNING) if strict else 0)
    return FAILED if failing else FINE


def fetch(
    *ids: str,
    table: Path | None = None,
    only: Annotated[tuple[str, ...], Several] = (),
    list_source: Annotated[str | None, Parameter(name="--list")] = None,
    dry_run: bool = False,
    resolution: tuple[str, ...] = (),
    request: Annotated[Fetching, Fields] = AS_USUAL,
    json: Json = False,
) -> int:
    """Fetch objects of published collections (YCB, Google Scanned Objects, Poly Haven), checked.

    A whole file is not fetched again. Without --table files are where data/objects.csv expects them.

    Parameters
    ----------
    ids
        SOURCE:NAME, as ycb:025_mug
    table
        fetch the objects of a table that have a source_id
    only
        only these ids of the table
    list_source
        print the ids of all that a source has
    dry_run
        print what would be fetched
    resolution
        [SOURCE=]NAME, as polyhaven=2k or google_64k (default: 1k, google_16k); may be given several times
    """
    from pipeline.intake.sources.registry import Resolutions, source_named, table_ids

    if sum(map(bool, (ids, table, list_source))) != 1:
        raise UsageError("fetch", "names no objects, or in several ways", "Give ids, or --table, or --list.")
    if only and not table:
        raise InputError("--only", "chooses from a table", "Give --table too.")
    where = table or Path("data/objects.csv")
    resolutions = Resolutions(resolution)
    with on_interrupt(RESUMED), status_line("fetching") as show:
        fetcher = request.fetcher(where, lambda url, count, total: show(_progress(url, count, total)))
        if list_source:
            source = source_named(list_source)
            names = [source.source_id(name) for name in fetcher.names(source)]
            print_text(json_text.dumps(names) if json else "\n".join(names))
            return FINE
        if table:
            ids = tuple(table_ids(table, only))
        ids = tuple(dict.fromkeys(ids))
        return (_list_missing if dry_run else _fetch)(fetcher, ids, resolutions, where, json=json)


def _fetch(
    fetcher: "Fetcher", ids: tuple[str, ...], resolutions: "Resolutions", table: Path, *, json: bool
) -> int:
    """Fetch all; print each object, and at the end the failures."""
    from pipeline.dataset.catalogue import read_rows
    from pipeline.intake.sources.fetch_summary import lines_of, summary

    try:
        rows = [row for _, row in read_rows(table)[1]]
    except InputError:
        rows = []  # a table that was not asked for need not be there
    objects, failures = [], []
    for number, (source_id, outcome) in enumerate(fetcher.fetch_all(ids, resolutions), start=1):
        count = f"{number}/{len(ids)} " if len(ids) > 1 else ""
        if isinstance(outcome, ObjectFolderError):
            failures.append(f"  {source_id}: {outcome.finding}")
            print_error(f"{count}{outcome}")
            continue
        objects.append(outcome)
        if not json:
            print_text(f"{count}{lines_of(outcome)}")
    if json:
        print(json_text.dumps([entry.figures() for entry in objects], indent=1))
    elif rows_and_count := summary(objects, table, rows, len(ids)):
        print_text(rows_and_count)
    if failures and len(ids) > 1:
        print_error(f"{len(failures)} of {len(ids)} failed; the same command resumes:")
        print_error("\n".join(failures))
    return FAILED if failures else FINE


def _list_missing(
    fetcher: "Fetcher", ids: tuple[str, ...], resolutions: "Resolutions", table: Path, *, json: bool
) -> int:
    """Print addresses and sizes of absent files; lists of files are fetched, files are not."""
    failures = total = unknown = 0
    figures: list[dict[str, str | int | None]] = []
    for source_id in ids:
        try:
            missing = fetcher.missing(resolutions.source_object(source_id))
        except ObjectFolderError as error:
            failures += 1
            print_error(error)
            continue
        if not json:
            print_text(f"{source_id}  {f'{len(missing)} to fetch' if missing else 'already there'}")
        for entry in missing:
            figures.append({"id": source_id, "url": str(entry.url), "bytes": entry.size})
            total += entry.size or 0
            unknown += entry.size is None
            size = "size unknown" if entry.size is None else f"{entry.size / 1e6:.2f} MB"
            if not json:
                print_text(f"  {entry.url}  {size}")
    if json:
        print(json_text.dumps(figures, indent=1))
    else:
        print_text(f"{total / 1e6:.1f} MB{f' and {unknown} files of unknown size' if unknown else ''}")
    return FAILED if failures else FINE


def _progress(url: str, count: int, total: int | None) -> str:
    size = f" of {total / 1e6:.1f}" if total is not None else ""
    return f"{count / 1e6:.1f}{size} MB  {url.rpartition('/')[2]}"
