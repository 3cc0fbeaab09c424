"""Containers that were scanned solid, and walls that a scan fused, thinned or tore."""

from collections.abc import Iterator

from objectfolder.geometry.vessels import CERTAIN, HEAVIER, LIGHTER, LIKELY, wall_findings
from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import NOTE, WARNING, Finding

RULE = "walls"

_SEVERITY = {CERTAIN: WARNING, LIKELY: WARNING}


def check(entry: Entry) -> Iterator[Finding]:
    """Find what `objectfolder.geometry.vessels` finds; masses alone are the rule `mass`."""
    if entry.shape is None or entry.record is None or entry.material is None:
        return
    for one in wall_findings(
        entry.shape.walls,
        material=entry.material.name,
        density_kg_m3=entry.material.density_kg_m3,
        mass_kg=entry.number("mass_kg"),
        words=entry.names,
        wall_m=entry.record.wall_m,
        shell_m=entry.record.shell_m,
    ):
        if one.kind not in (HEAVIER, LIGHTER):
            severity = _SEVERITY.get(one.certainty, NOTE)
            found = f"{one.kind} ({one.certainty}): {one.finding}"
            yield entry.found(RULE, severity, one.column or "mesh", found, one.remedy)
