"""A table of objects checked against itself, its meshes and what is known of sources and materials."""

import difflib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from objectfolder.audio.materials import Material, read_materials
from objectfolder.catalogue import read_catalogue, read_rows
from objectfolder.errors import InputError
from pipeline.intake.check import (
    duplicate_rule,
    length_rule,
    licence_rule,
    mass_rule,
    material_rule,
    mesh_rules,
    provenance_rule,
)
from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import ERROR, NOTE, SEVERITIES, WARNING, Finding
from pipeline.intake.check.shape import measure

ACCEPTED = "accepted"
BY_ROW: Mapping[str, Callable[[Entry], Iterator[Finding]]] = {
    mesh_rules.READABLE: mesh_rules.check_readable,
    licence_rule.RULE: licence_rule.check,
    provenance_rule.RULE: provenance_rule.check,
    length_rule.RULE: length_rule.check,
    mesh_rules.WALLS: mesh_rules.check_walls,
    mesh_rules.SURFACE: mesh_rules.check_surface,
}
RULES = (*BY_ROW, mass_rule.RULE, material_rule.RULE, duplicate_rule.RULE, ACCEPTED)


@dataclass(frozen=True)
class Check:
    """The findings of a check.

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
        Read and measure the meshes that are there, about a second each; else only the table.
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
    """Apply every rule to rows that were read; `known` is the table of materials."""
    doubles: dict[str, list[Finding]] = {}
    for one in duplicate_rule.check(entries):
        doubles.setdefault(one.object_id, []).append(one)
    findings: list[Finding] = []
    for entry in entries:
        findings += accept(entry, [*_of_row(entry, known), *doubles.pop(entry.object_id, ())])
    findings.sort(key=lambda one: SEVERITIES.index(one.severity))
    unfetched = tuple(entry.object_id for entry in entries if entry.is_unfetched)
    return Check(len(entries), sum(entry.shape is not None for entry in entries), unfetched, tuple(findings))


def accept(entry: Entry, findings: Sequence[Finding]) -> Iterator[Finding]:
    """Return the findings of a row; those that its column `accepted` lists become notes.

    The cell lists names of rules, and the notes say why. Errors cannot be accepted.
    """
    listed = [name for name in re.split(r"[\s,;]+", entry.cell(ACCEPTED)) if name]
    for name in listed:
        if name not in RULES:
            near = difflib.get_close_matches(name, RULES, 1)
            remedy = f"Did you mean {near[0]}?" if near else f"Use names of rules: {', '.join(RULES)}"
            yield entry.found(ACCEPTED, WARNING, ACCEPTED, f"there is no rule {name!r}", remedy)
        elif entry.shape is not None and name not in [one.rule for one in findings]:
            found = f"the rule {name!r} finds nothing"
            yield entry.found(ACCEPTED, NOTE, ACCEPTED, found, "Take it out of the list")
    if listed and not entry.cell("notes"):
        found = f"{', '.join(listed)} accepted without a reason"
        yield entry.found(ACCEPTED, WARNING, ACCEPTED, found, "Say why in the notes")
        listed = []
    for one in findings:
        accepted = one.rule in listed and one.severity != ERROR
        yield replace(one, severity=NOTE, accepted=True) if accepted else one


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
    found = [one for rule in BY_ROW.values() for one in rule(entry)]
    yield from found
    shells = any(one.rule == mesh_rules.WALLS and one.field == mass_rule.SHELL for one in found)
    for one in mass_rule.check(entry, known):
        # A shell that the walls ask for already is not asked for again because of the mass.
        if not (shells and one.field == mass_rule.SHELL):
            yield one
    yield from material_rule.check(entry, known.keys())
