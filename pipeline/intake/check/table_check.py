"""A table of objects checked against itself, its meshes and what is known of sources and materials."""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from objectfolder.errors import InputError
from objectfolder.making.materials import Material, read_materials
from pipeline.dataset.catalogue import read_catalogue, read_rows
from pipeline.dataset.counts import counted
from pipeline.dataset.failures import table_text
from pipeline.dataset.validation import did_you_mean
from pipeline.intake.check import duplicate_rule, mesh_rules, row_rules
from pipeline.intake.check.entry import ERROR, NOTE, SEVERITIES, WARNING, Entry, Finding, measure

ACCEPTED = "accepted"
BY_ROW: Mapping[str, Callable[[Entry], Iterator[Finding]]] = {
    row_rules.READABLE: row_rules.check_readable,
    row_rules.LICENCE: row_rules.check_licence,
    row_rules.PROVENANCE: row_rules.check_provenance,
    mesh_rules.LENGTH: mesh_rules.check_length,
    mesh_rules.WALLS: mesh_rules.check_walls,
    mesh_rules.SURFACE: mesh_rules.check_surface,
    mesh_rules.MASS: mesh_rules.check_mass,
    mesh_rules.LOOKS: mesh_rules.check_looks,
    row_rules.MATERIAL: row_rules.check_material,
}
RULES = (*BY_ROW, duplicate_rule.RULE, ACCEPTED)


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
    looks
        By the id of each measured row, what its mesh looks like in a line.
    """

    objects: int
    measured: int
    unfetched: tuple[str, ...]
    findings: tuple[Finding, ...]
    looks: Mapping[str, str]

    def count(self, severity: str) -> int:
        """Number of findings of a severity."""
        return sum(finding.severity == severity for finding in self.findings)


def check_table(
    path: Path,
    materials_table: Path,
    *,
    with_meshes: bool = True,
    progress: Callable[[int, int, str], None] = lambda *_: None,
) -> Check:
    """Check a table of objects; without meshes, which take a second each, only the table itself.

    Progress is called with rows done, rows and the id that comes next.

    Raises
    ------
    InputError
        A table that cannot be read at all.
    """
    entries = read_entries(path, read_materials(materials_table))
    if with_meshes:
        for index, entry in enumerate(entries):
            progress(index, len(entries), entry.object_id)
            entries[index] = measured(entry)
        progress(len(entries), len(entries), "")
    return check_entries(entries)


def check_entries(entries: Sequence[Entry]) -> Check:
    """Apply every rule to rows that were read."""
    doubles: dict[str, list[Finding]] = {}
    for finding in duplicate_rule.check(entries):
        doubles.setdefault(finding.object_id, []).append(finding)
    findings: list[Finding] = []
    for entry in entries:
        findings += accept(entry, [*_of_row(entry), *doubles.pop(entry.object_id, ())])
    findings.sort(key=lambda finding: SEVERITIES.index(finding.severity))
    unfetched = tuple(entry.object_id for entry in entries if entry.is_unfetched)
    looks = {entry.object_id: entry.shape.looks for entry in entries if entry.shape is not None}
    return Check(len(entries), len(looks), unfetched, tuple(findings), looks)


def accept(entry: Entry, findings: Sequence[Finding]) -> Iterator[Finding]:
    """Return the findings of a row; those that its column `accepted` lists become notes.

    The cell lists names of rules, and the notes say why. Errors cannot be accepted.
    """
    names = [name for name in re.split(r"[\s,;]+", entry.cell(ACCEPTED)) if name]
    for name in names:
        if name not in RULES:
            remedy = did_you_mean(name, RULES, f"Use names of rules: {', '.join(RULES)}")
            yield entry.finding(ACCEPTED, WARNING, ACCEPTED, f"there is no rule {name!r}", remedy)
        elif entry.shape is not None and name not in [finding.rule for finding in findings]:
            phrase = f"the rule {name!r} finds nothing"
            yield entry.finding(ACCEPTED, NOTE, ACCEPTED, phrase, "Take it out of the list")
    if names and not entry.cell("notes"):
        phrase = f"{', '.join(names)} accepted without a reason"
        yield entry.finding(ACCEPTED, WARNING, ACCEPTED, phrase, "Say why in the notes")
        names = []
    for finding in findings:
        is_accepted = finding.rule in names and finding.severity != ERROR
        yield replace(finding, severity=NOTE, accepted=True) if is_accepted else finding


def read_entries(path: Path, materials: Mapping[str, Material]) -> list[Entry]:
    """Return the rows of a table in order, those with faults too; nothing is measured yet."""
    _, rows = read_rows(path)
    catalogue = read_catalogue(path, materials)
    records = {record.id: record for record in catalogue.records}
    return [
        Entry(
            object_id=row["id"] or f"line {line}",
            cells=row,
            materials=materials,
            record=records.get(row["id"]),
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


def _of_row(entry: Entry) -> Iterator[Finding]:
    findings = [finding for rule in BY_ROW.values() for finding in rule(entry)]
    shells = any(
        finding.rule == mesh_rules.WALLS and finding.field == mesh_rules.SHELL for finding in findings
    )
    for finding in findings:
        # A shell that the walls ask for already is not asked for again because of the mass.
        if not (shells and finding.rule == mesh_rules.MASS and finding.field == mesh_rules.SHELL):
            yield finding


NARROWEST = 110  # characters


def text(check: Check, table: Path, width: int) -> str:
    """Return a table of findings, worst first, a line for each kind of looks, and a line that sums up."""
    # That files are not fetched is said once for all of them.
    unfetched = (NOTE, row_rules.READABLE)
    cells = [
        finding
        for finding in check.findings
        if (finding.severity, finding.rule) != unfetched or finding.accepted
    ]
    lines = _rows(cells, width)
    if check.unfetched:
        lines += [
            f"{len(check.unfetched)} not fetched ({_ids(check.unfetched)}): size, mass, walls and surface "
            f"were not checked. objectfolder fetch --table {table}"
        ]
    for looks, ids in _ids_by(check.looks).items():
        lines.append(f"looks  {_ids(ids)}: {looks}")
    counts = ", ".join(counted(check.count(severity), severity) for severity in (ERROR, WARNING, NOTE))
    acceptances = sum(finding.accepted for finding in check.findings)
    lines.append(
        f"{counted(check.objects, 'object')}, {check.measured} measured: {counts}"
        + (f" ({acceptances} accepted)" if acceptances else "")
    )
    return "\n".join(lines)


def _ids(ids: Sequence[str]) -> str:
    return ", ".join(ids[:3]) + (", ..." if len(ids) > 3 else "")


def _ids_by(looks: Mapping[str, str]) -> dict[str, list[str]]:
    """Ids by what these objects look like, in the order of the table."""
    ids: dict[str, list[str]] = {}
    for object_id, line in looks.items():
        ids.setdefault(line, []).append(object_id)
    return ids


def as_json(check: Check, table: Path) -> str:
    """Return all findings as JSON, those of the same severity in the order of the table."""
    content: dict[str, Any] = {
        "table": str(table),
        "objects": check.objects,
        "measured": check.measured,
        "unfetched": list(check.unfetched),
        "counts": {severity: check.count(severity) for severity in (ERROR, WARNING, NOTE)},
        "looks": dict(check.looks),
        "findings": [asdict(finding) for finding in check.findings],
    }
    return json.dumps(content, indent=1, ensure_ascii=False)


def _rows(findings: list[Finding], width: int) -> list[str]:
    """Return the lines of a table; what is the same for many objects stands once, where the first is."""
    if not findings:
        return []
    alike: dict[Finding, list[str]] = {}
    for finding in findings:
        alike.setdefault(replace(finding, object_id=""), []).append(finding.object_id)
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column("object", max_width=28, overflow="fold")
    table.add_column("field", no_wrap=True)
    table.add_column("found", min_width=30)
    table.add_column("remedy", min_width=30)
    for finding, ids in alike.items():
        objects = ids[0] if len(ids) == 1 else f"{ids[0]} and {len(ids) - 1} more"
        severity = "accepted" if finding.accepted else finding.severity
        table.add_row(*map(Text, (severity, objects, finding.field, finding.found, finding.remedy)))
    return table_text(table, max(width, NARROWEST)).splitlines()
