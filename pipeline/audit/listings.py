"""The findings of `verify` and `history` as plain text."""

from collections import defaultdict
from collections.abc import Sequence
from datetime import UTC, datetime

from pipeline.audit.fidelity import MEASURES
from pipeline.audit.history import ObjectVersion, Unreadable
from pipeline.audit.recomputation import Remade
from pipeline.audit.table import size, value
from pipeline.audit.texts import printable, wrapped
from pipeline.audit.verification import Verified

# One measure of each sense, and the size, beside the words of a history.
SHOWN = ("vision.psnr_foreground_db", "audio.gain_error_db", "touch.psnr_contact_db", "bytes.total")
FINDINGS = 200
INDENT = "    "


def verified_text(found: Verified, label: str, width: int) -> str:
    """Return what a verification found."""
    lines = []
    for one in found.findings[:FINDINGS]:
        lines += wrapped(f"{one.kind}: {one.where}: {one.finding}", width)
        lines += wrapped(one.remedy, width, INDENT)
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
        lines += wrapped(text, width)
    return "\n".join(lines)


def history_text(
    object_id: str, found: Sequence[ObjectVersion], unreadable: Sequence[Unreadable], width: int
) -> str:
    """Return the versions of an object, oldest first."""
    lines = [f"{printable(object_id)}: {len(found)} versions", ""]
    for one in found:
        day = datetime.fromtimestamp(one.commit.time, UTC).strftime("%Y-%m-%d")
        lines += wrapped(f"{one.commit.short} {day} {one.state}: {one.commit.subject}", width)
        prints = ", ".join(
            f"{stage} {one.fingerprints[stage]}" if stage in one.fingerprints else stage
            for stage in one.stages
        )
        cost = f"; {one.cpu_s:.1f} CPU s" if one.cpu_s is not None else ""
        measures = ", ".join(
            f"{key} {value(key, one.fidelity[key])}{f' {MEASURES[key].unit}' if MEASURES[key].unit else ''}"
            for key in SHOWN
            if key in one.fidelity
        )
        for text in (*one.reasons, f"{prints}{cost}", measures, *one.problems):
            lines += wrapped(text, width, INDENT)
    together: dict[str, list[str]] = defaultdict(list)
    for commit, error in unreadable:
        together[str(error)].append(commit.short)
    for text, commits in together.items():
        lines += wrapped(f"{', '.join(commits)}: {text}", width)
    return "\n".join(lines)
