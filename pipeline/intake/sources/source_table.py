"""The rows of a table of objects that come from sources, read without asking that their files are there."""

import csv
import difflib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import InputError


@dataclass(frozen=True)
class SourceRow:
    """A row of a table of objects.

    Parameters
    ----------
    id
        In the table.
    source_id
        As ``ycb:025_mug``; empty for an object that no source has.
    mesh, texture
        As in the table, relative to its folder.
    """

    id: str
    source_id: str
    mesh: str
    texture: str


def read_source_rows(table: Path) -> list[SourceRow]:
    """Read a table of objects.

    Raises
    ------
    InputError
        No such table, no CSV, or one without the columns `id` and `source_id`.
    """
    try:
        with table.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, strict=True)
            columns = [name.strip() for name in reader.fieldnames or ()]
            rows = [
                {name: (value or "").strip() for name, value in zip(columns, row.values(), strict=False)}
                for row in reader
            ]
    except FileNotFoundError:
        raise InputError(str(table), "the table of objects does not exist", "Correct the path") from None
    except (csv.Error, UnicodeDecodeError, AttributeError) as problem:
        raise InputError(
            str(table), f"is not a CSV table in UTF-8 ({problem})", "Export it again"
        ) from problem
    for name in ("id", "source_id"):
        if name not in columns:
            raise InputError(
                str(table), f"has no column {name!r}", "Add it: source_id says where from, as ycb:025_mug"
            )
    return [
        SourceRow(row["id"], row["source_id"], row.get("mesh", ""), row.get("texture", "")) for row in rows
    ]


def chosen_rows(table: Path, rows: list[SourceRow], only: Collection[str]) -> list[SourceRow]:
    """Return the rows that come from a source, of those named by id; all where none is named.

    Raises
    ------
    InputError
        A row that is named is not there, or comes from no source.
    """
    known = {row.id: row for row in rows}
    for object_id in only:
        if object_id not in known:
            near = difflib.get_close_matches(object_id, known, n=1)
            remedy = f"Did you mean {near[0]!r}?" if near else "Use an id of the table."
            raise InputError(str(table), f"there is no object {object_id!r}", remedy)
        if not known[object_id].source_id:
            raise InputError(f"{table}, {object_id}", "has no source_id", "Its files are not to be fetched.")
    return [row for row in rows if row.source_id and (not only or row.id in only)]
