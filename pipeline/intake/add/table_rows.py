"""Rows put into a table of objects: every byte of the other rows stays as it is."""

import csv
import io
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.products.atomic import write_whole
from objectfolder.products.regular_file import read_regular
from pipeline.dataset.catalogue import COLUMNS
from pipeline.intake import disk

BYTE_ORDER_MARK = "\ufeff"


@dataclass(frozen=True)
class Table:
    """A CSV table as text and as cells.

    Parameters
    ----------
    records
        Texts of the header and of each row, line ends included; empty lines are records, too.
    cells
        Stripped cells of each record.
    """

    records: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns; none for a table that is not there."""
        return self.cells[0] if self.cells else ()

    def rows(self) -> Iterator[tuple[int, dict[str, str]]]:
        """Yield index among the records, and cells by column, of each row that is not empty."""
        for index, cells in enumerate(self.cells[1:], start=1):
            if any(cells):
                full_row = [*cells, *[""] * (len(self.columns) - len(cells))]
                yield index, dict(zip(self.columns, full_row, strict=False))

    def row_of(self, object_id: str) -> tuple[int, dict[str, str]] | None:
        """Return the row with an id, case ignored as on some file systems; None without one."""
        for index, row in self.rows():
            if row.get("id", "").casefold() == object_id.casefold():
                return index, row
        return None


def read_table(path: Path) -> Table:
    """Read a table for editing; an empty one for a file that is not there.

    Raises
    ------
    InputError
        It is no CSV table in UTF-8, or it names no meshes.
    """
    if not path.exists():
        return Table((), ())
    records, cells = [], []
    start = 0
    try:
        lines = list(io.StringIO(read_regular(path).decode("utf-8"), newline=""))
        # The mark stays in the text of the header, and is no part of the first column's name.
        reader = csv.reader((line.removeprefix(BYTE_ORDER_MARK) for line in lines), strict=True)
        for row in reader:
            records.append("".join(lines[start : reader.line_num]))
            cells.append(tuple(cell.strip() for cell in row))
            start = reader.line_num
    except (csv.Error, UnicodeDecodeError) as problem:
        finding = f"is not a CSV table in UTF-8 ({problem})"
        raise InputError(str(path), finding, "Export it again") from problem
    table = Table(tuple(records), tuple(cells))
    missing = [name for name in ("id", "mesh", "material") if name not in table.columns]
    if cells and missing:
        remedy = "Name another table with --table: it is made if absent"
        raise InputError(str(path), f"has no column {missing[0]!r}", remedy)
    return table


def with_row(table: Table, row: Mapping[str, str], row_index: int | None = None) -> str:
    """Return the table's text with a row added at its end, or in place of the record `row_index`.

    Columns that the table lacks and the row fills are added to the header; cells of the replaced row in
    columns that `row` does not name stay.
    """
    if not table.cells:
        columns = [*COLUMNS, *(name for name in row if name not in COLUMNS and row[name])]
        return _written(columns, "\n") + _written([row.get(name, "") for name in columns], "\n")
    records = list(table.records)
    end = records[0][len(records[0].rstrip("\r\n")) :] or "\n"
    new = [name for name, value in row.items() if value and name not in table.columns]
    if new:
        head = records[0].rstrip("\r\n")
        records[0] = f"{head},{_written(new, end)}"
    columns = [*table.columns, *new]
    old_cells: Mapping[str, str] = {}
    if row_index is None:
        records[-1] += "" if records[-1].endswith(("\n", "\r")) else end
        row_index = len(records)
        records.append("")
    else:
        old_cells = dict(zip(table.columns, table.cells[row_index], strict=False))
    values = [row[name] if name in row else old_cells.get(name, "") for name in columns]
    records[row_index] = _written(values, end)
    return "".join(records)


def write_table(path: Path, text: str) -> None:
    """Put the table in its place whole; where the path is a link, the file it leads to."""
    write_whole(path.resolve(), text)


def locked(path: Path) -> AbstractContextManager[object]:
    """Lock a table against other additions; another process or thread waits."""
    path = path.resolve()
    return disk.locked(path.with_name(f".{path.name}.lock"))


def _written(row: list[str], end: str) -> str:
    text = io.StringIO(newline="")
    # Only characters of its own line end make it quote a cell: a lone return ends a line, too.
    csv.writer(text, lineterminator="\r\n").writerow(row)
    return text.getvalue().removesuffix("\r\n") + end
