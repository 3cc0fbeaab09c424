"""A table of objects against itself, its meshes and what is known of things."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from objectfolder.audio.materials import Material, read_materials
from objectfolder.catalogue import read_catalogue, read_rows
from objectfolder.errors import InputError
from pipeline.intake.check import duplicates, looks, readable, surfaces
from pipeline.intake.check import length as lengths
from pipeline.intake.check import mass as masses
from pipeline.intake.check import material as materials
from pipeline.intake.check import stated_licence as licences
from pipeline.intake.check import stated_provenance as provenance
from pipeline.intake.check import wall as walls
from pipeline.intake.check.acceptance import RULE as ACCEPTED
from pipeline.intake.check.acceptance import accept
from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import SEVERITIES, Finding
from pipeline.intake.check.shape import measure

BY_ROW = (readable, licences, provenance, lengths, walls, surfaces, looks)
RULES = (*(module.RULE for module in BY_ROW), masses.RULE, materials.RULE, duplicates.RULE, ACCEPTED)


@dataclass(frozen=True)
class Check:
    """What a check found.

    Parameters
    ----------
    objects
        Rows of the table.
    measured
        Rows whose mesh was measured.
    unfetched
        Ids of rows that wait for their files.
    findings
        Worst first, then in the order of the table.
    """

    objects: int
    measured: int
    unfetched: tuple[str, ...]
    findings: tuple[Finding, ...]

    def count(self, severity: str) -> int:
        """Number of findings of a severity."""
        return sum(one.severity == severity for one in self.findings)


def check_table(
    path: Path,
    materials_table: Path,
    *,
    with_meshes: bool = True,
    progress: Callable[[int, int, str], None] = lambda *_: None,
) -> Check:
    """Check a table of objects.

    Parameters
    ----------
    materials_table
        The table of materials.
    with_meshes
        Read and measure the meshes that are there, about a second each; else the table alone.
    progress
        Called with rows done, rows and the id that comes next.

    Raises
    ------
    InputError
        A table that cannot be read at all.
    """
    known = read_materials(materials_table)
    entries = read_entries(path, known)
    if with_meshes:
        for index, entry in enumerate(entries):
            progress(index, len(entries), entry.object_id)
            entries[index] = measured(entry)
        progress(len(entries), len(entries), "")
    return check_entries(entries, known)


def check_entries(entries: Sequence[Entry], known: Mapping[str, Material]) -> Check:
    """Apply every rule to rows that were read."""
    doubles: dict[str, list[Finding]] = {}
    for one in duplicates.check(entries):
        doubles.setdefault(one.object_id, []).append(one)
    findings: list[Finding] = []
    for entry in entries:
        found = [*_of_row(entry, known), *doubles.pop(entry.object_id, ())]
        findings += accept(entry, found, RULES)
    findings.sort(key=lambda one: SEVERITIES.index(one.severity))
    unfetched = tuple(entry.object_id for entry in entries if entry.is_unfetched)
    return Check(len(entries), sum(entry.shape is not None for entry in entries), unfetched, tuple(findings))


def read_entries(path: Path, known: Mapping[str, Material]) -> list[Entry]:
    """Return the rows of a table in order, those with faults too; nothing is measured yet."""
    _, rows = read_rows(path)
    catalogue = read_catalogue(path, known)
    records = {record.id: record for record in catalogue.records}
    return [
        Entry(
            object_id=row["id"] or f"line {line}",
            cells=row,
            record=records.get(row["id"]),
            material=known.get(row["material"]),
            problem=catalogue.errors.get(row["id"] or f"line {line}"),
        )
        for line, row in rows
    ]


def measured(entry: Entry) -> Entry:
    """Return a row with what was measured on its mesh, or why that could not be."""
    if entry.record is None:
        return entry
    try:
        return replace(entry, shape=measure(entry.record))
    except InputError as problem:
        return replace(entry, problem=problem)


def _of_row(entry: Entry, known: Mapping[str, Material]) -> Iterator[Finding]:
    found = [one for module in BY_ROW for one in module.check(entry)]
    yield from found
    shells = any(one.rule == walls.RULE and one.field == masses.SHELL for one in found)
    for one in masses.check(entry, known):
        # What the walls say already is not said again of the mass that follows from them.
        if not (shells and one.field == masses.SHELL):
            yield one
    yield from materials.check(entry, known.keys())
