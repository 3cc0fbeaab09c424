"""A summary of fetched objects, in lines for people."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from pipeline.intake.sources.fetching import Fetched
from pipeline.intake.sources.proposed_row import proposed_rows
from pipeline.intake.sources.source_table import SourceRow


def lines_of(fetched: Fetched) -> str:
    """Return what an object is, and where its files are."""
    source = fetched.asked.source
    size = f"{len(fetched.form.files)} files, {fetched.bytes / 1e6:.2f} MB"
    new = f", hashes recorded: {fetched.recorded}" if fetched.recorded else ""
    return (
        f"{fetched.asked.id}  {fetched.outcome}, {size}{new}\n"
        f"  mesh     {fetched.mesh}\n"
        f"  texture  {fetched.texture or 'named by the mesh'}\n"
        f"  licence  {source.licence}; {source.attribution}"
    )


def differences(fetched: Fetched, table: Path, rows: Iterable[SourceRow]) -> Iterator[str]:
    """Yield which rows of a table name other files than those that were fetched."""
    for row in rows:
        if row.source_id != fetched.asked.id:
            continue
        for what, cell, path in (("mesh", row.mesh, fetched.mesh), ("texture", row.texture, fetched.texture)):
            if cell and (path is None or (table.parent / cell).resolve() != path.resolve()):
                yield f"{table}, {row.id}: its {what} is {cell}, but {path} was fetched"


def summary(fetched: Sequence[Fetched], table: Path, rows: Iterable[SourceRow], count: int) -> str:
    """Return rows to add to the table for new objects and, of several objects, how many there are."""
    in_table = {row.source_id for row in rows}
    new = [one for one in fetched if one.asked.id not in in_table]
    lines = []
    if new:
        lines += [f"\nRows for {table}, each to be given its material:"]
        lines += [proposed_rows(new, table.parent).rstrip("\n")]
    if count > 1:
        lines += [f"{len(fetched)} of {count} are there, {sum(one.bytes for one in fetched) / 1e6:.1f} MB"]
    return "\n".join(lines)
