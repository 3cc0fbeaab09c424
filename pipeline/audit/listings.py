"""What `verify` and `history` find, as plain text."""

import textwrap
from collections import defaultdict
from collections.abc import Sequence
from datetime import UTC, datetime

from pipeline.audit.fidelity import MEASURES
from pipeline.audit.history import ObjectVersion, Unreadable
from pipeline.audit.recomputation import Remade
from pipeline.audit.table import size, value
from pipeline.audit.texts import printable
from pipeline.audit.verification import Verified

# One measure of each sense, and the size, beside the words of a history.
SHOWN = ("vision.psnr_foreground_db", "audio.gain_error_db", "touch.psnr_contact_db", "bytes.total")
FINDINGS = 200


def verified_text(found: Verified, label: str, width: int) -> str:
    """Return what a verification found."""
    lines = []
    for one in found.findings[:FINDINGS]:
        text = printable(f"{one.kind}: {one.where}: {one.finding}")
        lines += textwrap.wrap(text, width, subsequent_indent="  ")
        lines += _indented(printable(one.remedy), width)
    if len(found.findings) > FINDINGS:
        lines.append(f"... and {len(found.findings) - FINDINGS} more (--json has all)")
    verdict = f"{len(found.findings)} findings" if found.findings else "nothing wrong"
    lines.append(f"{label}: {found.files} files, {size(found.bytes)} read: {verdict}")
    return "\n".join(lines)


def remade_text(found: Sequence[Remade], width: int) -> str:
    """Return how products made again compare."""
    lines = []
    for one in found:
        counts = one.arrays.count()
        numbers = ", ".join(f"{counts[verdict]} {verdict}" for verdict in sorted(counts))
        text = f"{one.stage} {one.object_id}: {one.verdict}"
        text += f" ({numbers}; {one.cpu_s:.1f} CPU s)" if numbers else ""
        text += f": {one.finding}" if one.finding else ""
        lines += textwrap.wrap(printable(text), width, subsequent_indent="    ", break_on_hyphens=False)
    return "\n".join(lines)


def history_text(
    object_id: str, found: Sequence[ObjectVersion], unreadable: Sequence[Unreadable], width: int
) -> str:
    """Return the versions of an object, oldest first."""
    lines = [f"{printable(object_id)}: {len(found)} versions", ""]
    for one in found:
        day = datetime.fromtimestamp(one.commit.time, UTC).strftime("%Y-%m-%d")
        lines += textwrap.wrap(
            f"{one.commit.short} {day} {one.state}: {printable(one.commit.subject)}",
            width, subsequent_indent="  ",
        )  # fmt: skip
        for reason in one.reasons:
            lines += _indented(printable(reason), width)
        prints = ", ".join(
            f"{stage} {one.fingerprints[stage]}" if stage in one.fingerprints else stage
            for stage in one.stages
        )
        cost = f"; {one.cpu_s:.1f} CPU s" if one.cpu_s is not None else ""
        lines += _indented(f"{prints}{cost}", width)
        measures = ", ".join(
            f"{key} {value(key, one.fidelity[key])}{f' {MEASURES[key].unit}' if MEASURES[key].unit else ''}"
            for key in SHOWN
            if key in one.fidelity
        )
        if measures:
            lines += _indented(measures, width)
        for problem in one.problems:
            lines += _indented(printable(problem), width)
    together: dict[str, list[str]] = defaultdict(list)
    for commit, error in unreadable:
        together[str(error)].append(commit.short)
    for text, commits in together.items():
        lines += textwrap.wrap(printable(f"{', '.join(commits)}: {text}"), width, subsequent_indent="  ")
    return "\n".join(lines)


def _indented(text: str, width: int) -> list[str]:
    return textwrap.wrap(
        text, width, initial_indent="    ", subsequent_indent="      ", break_on_hyphens=False
    )
