"""An audit as plain text of a terminal's width."""

import math
from collections.abc import Sequence

from pipeline.audit.fidelity import MEASURES, FidelityChange
from pipeline.audit.findings import Audit
from pipeline.audit.groups import counts, groups, names, totals
from pipeline.audit.reasons import UPSTREAM
from pipeline.audit.texts import printable, wrapped

NARROWEST, WIDEST = 72, 120
GROUPS = 40
FIDELITY_ROWS = 20
LEAST_WEIGHT = 0.01  # of what a person would notice


def table(audit: Audit, width: int = 100) -> str:
    """Return what an audit found, for people.

    Parameters
    ----------
    audit
        What it found.
    width
        Columns of the terminal.
    """
    width = min(max(width, NARROWEST), WIDEST)
    blocks = [
        _heading(audit, width),
        _groups(audit, width),
        _stages(audit),
        _fidelity(audit.fidelity),
        _costs(audit, width),
        _problems(audit, width),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block)


def size(count: float) -> str:
    """Return bytes for people."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1000 or unit == "GB":
            return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.1f} {unit}"
        count /= 1000
    raise AssertionError(count)


def value(measure: str, found: float | None) -> str:
    """Return a measure's value for people."""
    if found is None:
        return "none"
    decimals = MEASURES[measure].decimals + 1 if MEASURES[measure].unit != "bytes" else 0
    return f"{found:.{decimals}f}"


def change(one: FidelityChange) -> str:
    """Return by how much a measure changed, for people."""
    if one.before is None or one.after is None:
        return "lost" if math.isinf(one.loss) and one.loss > 0 else "new"
    loss = value(one.measure, abs(one.loss))
    if not loss.strip("0."):
        loss = f"{abs(one.loss):.1g}"  # less than the decimals that the measure is printed with
    return f"{'worse' if one.loss > 0 else 'better'} by {loss}"


def cost(audit: Audit) -> str:
    """Return the CPU seconds of the new products."""
    found = totals(audit)
    made, costed = sum(one.made for one in found), sum(one.costed for one in found)
    if not made:
        return "nothing"
    if not costed:
        return f"{made} products; what they took is not noted here"
    spent = sum(one.cpu_s for one in found)
    return f"{made} products in {spent:.0f} CPU s" + (f" (known of {costed})" if costed < made else "")


def _heading(audit: Audit, width: int) -> list[str]:
    lines = wrapped(f"from  {audit.old}", width) + wrapped(f"to    {audit.new}", width)
    return [*lines, "", f"{len(audit.objects)} objects: {counts(audit)}"]


def _groups(audit: Audit, width: int) -> list[str]:
    found = groups(audit)
    lines = []
    for one in found[:GROUPS]:
        count = f" ({len(one.objects)})" if len(one.objects) > 1 else ""
        lines += wrapped(f"{one.state}{count}: {names(one.objects)}", width)
        for reason in one.reasons:
            lines += wrapped(reason, width, "    ")
        places = []
        if one.direct:
            places.append("in " + ", ".join(one.direct))
        if one.behind:
            places.append(f"{UPSTREAM} of {', '.join(one.behind)}")
        if places:
            lines += wrapped("; ".join(places), width, "    ")
    if len(found) > GROUPS:
        lines.append(f"... and {len(found) - GROUPS} groups more (--json and --html have all)")
    return lines


def _stages(audit: Audit) -> list[str]:
    found = totals(audit)
    if not found:
        return []
    columns = ("changed", "made", "gone", "= arrays", "~ arrays", "!= arrays", "not read", "CPU s")
    lines = _columns([("stage", *columns), *((one.stage, *one.cells) for one in found)], 1)
    if not audit.arrays_read:
        lines.append("Arrays compared by their checksums (= equal, != different); --arrays reads them.")
    else:
        lines.append("Arrays and attributes read: = equal, ~ within tolerance, != different.")
    return lines


def _fidelity(found: Sequence[FidelityChange]) -> list[str]:
    if not found:
        return []
    felt = [one for one in found if abs(one.weight) >= LEAST_WEIGHT]
    shown = felt[:FIDELITY_ROWS]
    if not shown:
        return [f"fidelity: {len(found)} changes, all below a hundredth of what a person would notice"]
    rows = [("object", "measure", "before", "after", "change")]
    for one in shown:
        unit = MEASURES[one.measure].unit
        name = f"{one.measure} ({unit})" if unit not in ("", "bytes") else one.measure
        before, after = value(one.measure, one.before), value(one.measure, one.after)
        rows.append((printable(one.object_id), name, before, after, change(one)))
    lines = ["fidelity, worst changes first", *_columns(rows, 2)]
    if len(found) > len(shown):
        smaller = len(found) - len(felt)
        lines.append(
            f"... and {len(felt) - len(shown)} more, {smaller} hardly any (--json and --html have all)"
        )
    return lines


def _costs(audit: Audit, width: int) -> list[str]:
    lines = [f"made anew: {cost(audit)}"]
    fetch = audit.fetch
    unknown = f", and {fetch.unknown} files of unknown size" if fetch.unknown else ""
    if fetch.unlisted:
        unknown += f", and what {', '.join(map(printable, fetch.unlisted))} has, of which the list is unknown"
    parts = ", ".join(f"{path} {size(count)}" for path, count in fetch.by_out.items() if count)
    text = f"to fetch: {size(fetch.bytes)} in {fetch.files} files{unknown}{f' ({parts})' if parts else ''}"
    return lines + wrapped(text, width)


def _problems(audit: Audit, width: int) -> list[str]:
    return [line for error in audit.problems for line in wrapped(f"incomplete: {error}", width)]


def _columns(rows: Sequence[Sequence[str]], texts: int) -> list[str]:
    """Return rows as lines; the first columns are texts, the others numbers."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if index < texts else cell.rjust(width)
            for index, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]
