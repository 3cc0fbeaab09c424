"""Rows put into a table of objects: every byte of the other rows stays as it is."""

import contextlib
import csv
import fcntl
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from objectfolder.atomic import atomic_write
from objectfolder.errors import InputError

FIRST_COLUMNS = (
    "id", "name", "mesh", "texture", "material", "length_m", "source", "licence", "attribution", "roughness",
    "metallic", "wall_m", "shell_m",
)  # fmt: skip
"""Columns of a table that is made."""

BYTE_ORDER_MARK = "\ufeff"


@dataclass(frozen=True)
class Table:
    """A CSV table as text and as cells.

    Parameters
    ----------
    path
        The file; it need not be there.
    mark
        A byte order mark, or nothing.
    records
        Texts of the header and of each row, line ends included; empty lines are records, too.
    cells
        Stripped cells of each record.
    """

    path: Path
    mark: str
    records: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns; none for a table that is not there."""
        return self.cells[0] if self.cells else ()

    def rows(self) -> Iterator[tuple[int, dict[str, str]]]:
        """Index among the records, and cells by column, of each row that is not empty."""
        for index, cells in enumerate(self.cells[1:], start=1):
            if any(cells):
                padded = [*cells, *[""] * (len(self.columns) - len(cells))]
                yield index, dict(zip(self.columns, padded, strict=False))

    def row_of(self, object_id: str) -> tuple[int, dict[str, str]] | None:
        """The row with an id, case ignored as on some file systems; None without one."""
        for index, row in self.rows():
            if row.get("id", "").casefold() == object_id.casefold():
                return index, row
        return None


def read_table(path: Path) -> Table:
    """Read a table for editing; an empty one for a file that is not there.

    Raises
    ------
    InputError
        It is no CSV table in UTF-8, its records cannot be told apart, or it names no meshes.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return Table(path, "", (), ())
    try:
        text = data.decode("utf-8")
        mark = BYTE_ORDER_MARK if text.startswith(BYTE_ORDER_MARK) else ""
        records = _records(text[len(mark) :])
        cells = tuple(_cells(record) for record in records)
        whole = list(csv.reader(io.StringIO(text[len(mark) :], newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error, ValueError) as problem:
        raise InputError(
            str(path), f"is not a CSV table in UTF-8 ({problem})", "Export it again"
        ) from problem
    if [tuple(cell.strip() for cell in row) for row in whole] != list(cells):
        raise InputError(str(path), "has quotes that can be read in two ways", "Add the row by hand")
    table = Table(path, mark, records, cells)
    missing = [name for name in ("id", "mesh", "material") if name not in table.columns]
    if cells and missing:
        raise InputError(
            str(path),
            f"has no column {missing[0]!r}",
            "Name another table with --table: it is made if absent",
        )
    return table


def with_row(table: Table, row: Mapping[str, str], replaced: int | None = None) -> str:
    """Text of the table with a row added at its end, or in place of the record `replaced`.

    Columns that the table lacks and the row fills are added to the header; cells of the replaced row in
    columns that `row` does not name stay.
    """
    if not table.cells:
        columns = [*FIRST_COLUMNS, *(name for name in row if name not in FIRST_COLUMNS and row[name])]
        return _written([columns, [row.get(name, "") for name in columns]], "\n")
    end = _line_end(table.records)
    columns = list(table.columns)
    records = list(table.records)
    added = [name for name, value in row.items() if value and name not in columns]
    if added:
        head = records[0].rstrip("\r\n")
        records[0] = head + "," + _written([added], records[0][len(head) :] or end)
        columns += added
    if replaced is None:
        kept: Mapping[str, str] = {}
        if not records[-1].endswith(("\n", "\r")):
            records[-1] += end
        records.append("")
        replaced = len(records) - 1
    else:
        kept = dict(zip(table.columns, table.cells[replaced], strict=False))
    values = [row[name] if name in row else kept.get(name, "") for name in columns]
    records[replaced] = _written([values], end)
    return table.mark + "".join(records)


def write_table(path: Path, text: str) -> None:
    """Put the table in its place whole; where the path is a link, the file it leads to."""
    with atomic_write(path.resolve()) as file:
        file.write(text.encode("utf-8"))


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a table against other additions; waits. The lock ends with its process, however that ends."""
    path = path.resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    with (path.parent / f".{path.name}.lock").open("ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _records(text: str) -> tuple[str, ...]:
    """Lines, joined where a quoted cell goes on in the next."""
    records: list[str] = []
    pending = ""
    for line in io.StringIO(text, newline=""):
        pending += line
        if pending.count('"') % 2 == 0:
            records.append(pending)
            pending = ""
    if pending:
        raise ValueError("a quoted cell does not end")
    return tuple(records)


def _cells(record: str) -> tuple[str, ...]:
    rows = list(csv.reader(io.StringIO(record, newline=""), strict=True))
    return tuple(cell.strip() for cell in rows[0]) if rows else ()


def _line_end(records: tuple[str, ...]) -> str:
    head = records[0]
    return head[len(head.rstrip("\r\n")) :] or "\n"


def _written(rows: list[list[str]], end: str) -> str:
    return "".join(_written_row(row).removesuffix("\r\n") + end for row in rows)


def _written_row(row: list[str]) -> str:
    text = io.StringIO(newline="")
    # Only characters of its own line end make it quote a cell: a lone return ends a line, too.
    csv.writer(text, lineterminator="\r\n").writerow(row)
    return text.getvalue()
