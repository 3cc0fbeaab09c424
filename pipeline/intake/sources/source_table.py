"""The rows of a table of objects that name a source; their files need not be there."""

import difflib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from objectfolder.catalogue import read_rows
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
    """Read a table of objects; InputError for what is none, or has no column `source_id`."""
    columns, rows = read_rows(table)
    if "source_id" not in columns:
        remedy = "Add it: source_id says where from, as ycb:025_mug"
        raise InputError(str(table), "has no column 'source_id'", remedy)
    return [SourceRow(row["id"], row["source_id"], row["mesh"], row.get("texture", "")) for _, row in rows]


def chosen_rows(table: Path, rows: list[SourceRow], only: Collection[str]) -> list[SourceRow]:
    """Return the rows that name a source, of those with the ids `only`; all for an empty `only`.

    Raises
    ------
    InputError
        An id that is not there, or names no source.
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
