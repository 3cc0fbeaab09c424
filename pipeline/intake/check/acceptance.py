"""What a table says was looked at and stays: the column `accepted`."""

import difflib
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import ERROR, NOTE, WARNING, Finding

RULE = "accepted"


def accept(entry: Entry, findings: Sequence[Finding], rules: Sequence[str]) -> Iterator[Finding]:
    """Return the findings of a row, doubts that it accepts as notes.

    The cell lists names of rules, and the notes say why. Errors cannot be accepted.

    Parameters
    ----------
    rules
        Names there are.
    """
    listed = [name for name in re.split(r"[\s,;]+", entry.cell("accepted")) if name]
    for name in listed:
        if name not in rules:
            near = difflib.get_close_matches(name, rules, 1)
            remedy = f"Did you mean {near[0]}?" if near else f"Use names of rules: {', '.join(rules)}"
            yield entry.found(RULE, WARNING, "accepted", f"there is no rule {name!r}", remedy)
        elif entry.shape is not None and name not in [one.rule for one in findings]:
            found = f"the rule {name!r} finds nothing"
            yield entry.found(RULE, NOTE, "accepted", found, "Take it out of the list")
    if listed and not entry.cell("notes"):
        found = f"{', '.join(listed)} accepted without a reason"
        yield entry.found(RULE, WARNING, "accepted", found, "Say why in the notes")
        listed = []
    for one in findings:
        accepted = one.rule in listed and one.severity != ERROR
        yield replace(one, severity=NOTE, accepted=True) if accepted else one
