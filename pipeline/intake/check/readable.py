"""Rows that cannot be read or built, and cells that are no numbers."""

from collections.abc import Iterator

from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import ERROR, NOTE, WARNING, Finding

RULE = "readable"

NUMBERS = ("mass_kg", "paper_length_m", "paper_index")
"""Columns of numbers above 0 that the factory itself passes over."""


def check(entry: Entry) -> Iterator[Finding]:
    """Find what keeps a row from being built; what is only not fetched yet is a note."""
    if entry.problem is not None:
        column = entry.problem.where.rpartition("field ")[2] if "field " in entry.problem.where else "mesh"
        severity = NOTE if entry.is_unfetched else ERROR
        found = "is not fetched: size, mass, walls and surface were not checked"
        if not entry.is_unfetched:
            found = entry.problem.finding
        yield entry.found(RULE, severity, column, found, entry.problem.remedy)
    for column in NUMBERS:
        if entry.cell(column) and entry.number(column) is None:
            found = f"{entry.cell(column)!r} is not a number above 0"
            yield entry.found(RULE, WARNING, column, found, "Correct it, or leave it empty")
