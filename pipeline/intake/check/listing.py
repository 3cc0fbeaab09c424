"""The findings of a check, as a table for people and as JSON."""

import io
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from pipeline.intake.check.entry import ERROR, NOTE, WARNING, Finding
from pipeline.intake.check.table_check import Check

NARROWEST = 110  # characters


def text(check: Check, table: Path, width: int) -> str:
    """Return a table of severity, object, field, finding and remedy, worst first, and a line that sums up."""
    shown = [one for one in check.findings if not (one.severity == NOTE and _is_unfetched(one, check))]
    lines = _rows(shown, width)
    if check.unfetched:
        some = ", ".join(check.unfetched[:3]) + (", ..." if len(check.unfetched) > 3 else "")
        lines += [
            f"{len(check.unfetched)} not fetched ({some}): size, mass, walls and surface were not checked. "
            f"objectfolder fetch --table {table}"
        ]
    counts = ", ".join(
        f"{check.count(severity)} {severity}{'' if check.count(severity) == 1 else 's'}"
        for severity in (ERROR, WARNING, NOTE)
    )
    accepted = sum(one.accepted for one in check.findings)
    lines.append(
        f"{check.objects} object{'' if check.objects == 1 else 's'}, {check.measured} measured: {counts}"
        + (f" ({accepted} accepted)" if accepted else "")
    )
    return "\n".join(lines)


def as_json(check: Check, table: Path) -> str:
    """Return all findings as JSON, those of the same severity in the order of the table."""
    content: dict[str, Any] = {
        "table": str(table),
        "objects": check.objects,
        "measured": check.measured,
        "unfetched": list(check.unfetched),
        "counts": {severity: check.count(severity) for severity in (ERROR, WARNING, NOTE)},
        "findings": [asdict(one) for one in check.findings],
    }
    return json.dumps(content, indent=1, ensure_ascii=False)


def _is_unfetched(one: Finding, check: Check) -> bool:
    return one.object_id in check.unfetched and one.remedy.startswith("objectfolder fetch ")


def _rows(findings: list[Finding], width: int) -> list[str]:
    """Return the lines of a table; what is the same for many objects stands once, where the first is."""
    if not findings:
        return []
    alike: dict[Finding, list[str]] = {}
    for one in findings:
        alike.setdefault(replace(one, object_id=""), []).append(one.object_id)
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column("object", max_width=28, overflow="fold")
    table.add_column("field", no_wrap=True)
    table.add_column("found", min_width=30)
    table.add_column("remedy", min_width=30)
    for one, ids in alike.items():
        objects = ids[0] if len(ids) == 1 else f"{ids[0]} and {len(ids) - 1} more"
        severity = "accepted" if one.accepted else one.severity
        table.add_row(*map(Text, (severity, objects, one.field, one.found, one.remedy)))
    lines = io.StringIO()
    Console(file=lines, width=max(width, NARROWEST), color_system=None).print(table)
    return [line.rstrip() for line in lines.getvalue().splitlines()]
