"""What a check found, as a table for people and as JSON."""

import json
import textwrap
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from pipeline.intake.check.check import Check
from pipeline.intake.check.finding import ERROR, NOTE, WARNING, Finding

NARROWEST = 30
ACCEPTED = "accepted"
FIRST = len(ACCEPTED)


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
    if not findings:
        return []
    names = min(28, max(len("object"), *(len(ids) for ids, _ in _together(findings))))
    fields = max(len("field"), *(len(one.field) for one in findings))
    rest = max(NARROWEST, (width - names - fields - FIRST - 8) // 2)
    widths = (FIRST, names, fields, rest, rest)
    lines = [_line(("", "object", "field", "found", "remedy"), widths)]
    for ids, one in _together(findings):
        severity = ACCEPTED if one.accepted else one.severity
        cells = [
            textwrap.wrap(cell, size) or [""]
            for cell, size in zip((severity, ids, one.field, one.found, one.remedy), widths, strict=True)
        ]
        for row in range(max(map(len, cells))):
            lines.append(_line([cell[row] if row < len(cell) else "" for cell in cells], widths))
    return lines


def _together(findings: list[Finding]) -> list[tuple[str, Finding]]:
    """Findings with whom they are about: those that say the same of many objects once, where the first is."""
    alike: dict[Finding, list[str]] = {}
    for one in findings:
        alike.setdefault(replace(one, object_id=""), []).append(one.object_id)
    return [
        (ids[0] if len(ids) == 1 else f"{ids[0]} and {len(ids) - 1} more", one) for one, ids in alike.items()
    ]


def _line(cells: list[str] | tuple[str, ...], widths: tuple[int, ...]) -> str:
    return "  ".join(f"{cell:<{size}}" for cell, size in zip(cells, widths, strict=True)).rstrip()
