"""The findings of the commands: as JSON, and as plain text of a terminal's width."""

import re
import textwrap
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
from pydantic_core import to_json
from rich.filesize import decimal

from objectfolder.errors import ObjectFolderError, printable
from pipeline.audit.fidelity import MEASURES, FidelityChange
from pipeline.audit.findings import Audit, change, cost, counts, groups, names, numbered, totals, value
from pipeline.audit.history import GONE, ObjectVersion, Unreadable
from pipeline.audit.recomputation import Remade
from pipeline.audit.verification import Verified
from pipeline.dataset.counts import columns, counted
from pipeline.dataset.lock_file import MD5
from pipeline.dataset.measures import BYTES, HEADLINE

TEMPLATES = Path(__file__).parent / "template"
NARROWEST, WIDEST = 72, 120
GROUPS, IDS, FIDELITY_ROWS, FINDINGS = 40, 6, 20, 200  # that are shown
LEAST_WEIGHT = 0.01  # of what a person would notice
COLUMNS = ("stage", "changed", "made", "gone", "= arrays", "~ arrays", "!= arrays", "not read", "CPU s")
# One measure of each sense, and the size, beside the words of a history.
SHOWN = (*(measure.key for measure in HEADLINE), BYTES.key)


def as_json(content: Mapping[str, Any]) -> str:
    """Return findings as JSON; a number that is not finite is null."""

    def error(problem: ObjectFolderError) -> dict[str, str]:
        return {"where": problem.where, "finding": problem.finding, "remedy": problem.remedy}

    return to_json(content, indent=1, inf_nan_mode="null", fallback=error).decode()


def audit_text(
    audit: Audit,
    exceeded: Sequence[FidelityChange],
    allowed: Mapping[str, float],
    width: int,
    *,
    whole: bool = False,
) -> str:
    """Return what an audit found, and what of it exceeds the largest loss allowed by measure, for people.

    A terminal gets the first groups, ids and changes only, unless `whole`.
    """
    notable_changes = [figure for figure in audit.fidelity if abs(figure.weight) >= LEAST_WEIGHT]
    stages, rows = totals(audit), len(notable_changes) if whole else FIDELITY_ROWS
    return _rendered(
        "audit",
        width,
        audit=audit,
        counts=counts(audit),
        groups=groups(audit),
        most=len(audit.objects) if whole else GROUPS,
        ids=len(audit.objects) if whole else IDS,
        stages=[COLUMNS, *((total.stage, *total.cells) for total in stages)] if stages else [],
        fidelity=fidelity_rows(notable_changes[:rows]),
        means=fidelity_rows(audit.means),
        unshown=len(notable_changes[rows:]),
        smaller=len(audit.fidelity) - len(notable_changes),
        cost=cost(stages),
        exceeded=exceeded,
        allowed=allowed,
    )


def fidelity_rows(changes: Sequence[FidelityChange]) -> list[tuple[str, ...]]:
    """Return a table of changes with its head; nothing for no change."""
    head = ("object", "measure", "before", "after", "change")
    rows: list[tuple[str, ...]] = [head] if changes else []
    for figure in changes:
        unit = MEASURES[figure.measure].unit
        name = f"{figure.measure} ({unit})" if unit not in ("", "bytes") else figure.measure
        before, after = (
            value(figure.measure, figure.before),
            value(figure.measure, figure.after),
        )
        rows.append((figure.object_id, name, before, after, change(figure)))
    return rows


def verified_text(verification: Verified, remade: Sequence[Remade], label: str, width: int) -> str:
    """Return what a verification found, and how products made again compare."""
    return _rendered("verified", width, verified=verification, remade=remade, label=label, most=FINDINGS)


def history_text(
    object_id: str, versions: Sequence[ObjectVersion], unreadable: Sequence[Unreadable], width: int
) -> str:
    """Return the versions of an object, oldest first."""
    together: dict[str, list[str]] = defaultdict(list)
    for commit, error in unreadable:
        together[MD5.sub("a list of files", str(error))].append(commit.short)
    # A commit that removed it is listed, and is no version.
    count = sum(version.state != GONE for version in versions)
    return _rendered(
        "history", width, object_id=object_id, count=count, versions=versions, unreadable=together
    )


def _rendered(template: str, width: int, **context: object) -> str:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=printable,
    )

    def wrapped(text: str, indent: str = "") -> str:
        columns = min(max(width, NARROWEST), WIDEST)
        return textwrap.fill(
            text, columns, initial_indent=indent, subsequent_indent=f"{indent}  ", break_on_hyphens=False
        )

    environment.filters |= {
        "wrapped": wrapped, "columns": columns, "measured": _measured, "names": names, "numbered": numbered,
        "counted": counted, "size": decimal, "change": change,
    }  # fmt: skip
    text = environment.get_template(f"{template}.txt.j2").render(context)
    return re.sub(r"\n{3,}", "\n\n", text).strip("\n")


def _measured(fidelity: Mapping[str, float]) -> str:
    keys = (key for key in SHOWN if key in fidelity)
    return ", ".join(f"{key} {value(key, fidelity[key])} {MEASURES[key].unit}".rstrip() for key in keys)
