"""What a release says of the one before it: a section of Markdown, and the version of each object."""

import csv
import io
from collections.abc import Mapping

from pipeline.audit.findings import Audit, counts, groups, names
from pipeline.audit.rendering import FIDELITY_ROWS, LEAST_WEIGHT, fidelity_rows
from pipeline.dataset.counts import counted
from pipeline.publish.cards.data_card import escape

TITLE = "# Changes of the data set\n"
MOST_IDS = 50
OBJECT, VERSION, DIGEST = "object", "version", "md5"


def section(version: str, day: str, audit: Audit) -> str:
    """Return what changed since the release before, and why, as a section of Markdown."""
    lines = [f"## {version}, {day}", "", f"{counted(len(audit.objects), 'object')}: {counts(audit)}."]
    for group in groups(audit):
        lines += ["", f"**{escape(group.title)}**: {escape(names(group.objects, MOST_IDS))}"]
        lines += [f"- {escape(text)}" for text in (*group.reasons, group.places) if text]
    notable_changes = [
        figure
        for figure in audit.fidelity
        if figure.before is not None and abs(figure.weight) >= LEAST_WEIGHT
    ]
    for title, changes in (("Objects", notable_changes[:FIDELITY_ROWS]), ("Means", audit.means)):
        head, *rows = fidelity_rows(changes) or [()]
        if rows:
            cells = [head, ["---"] * len(head), *rows]
            lines += ["", f"{title} whose fidelity changed, worst first:", ""]
            lines += [f"| {' | '.join(map(escape, row))} |" for row in cells]
    if len(notable_changes) > FIDELITY_ROWS:
        lines += [
            "",
            f"{len(notable_changes) - FIDELITY_ROWS} more of objects; `objectfolder audit --json` has all.",
        ]
    return "\n".join(lines) + "\n"


def with_section(changelog: str, text: str) -> str:
    """Return a changelog with a new section at its top."""
    return f"{TITLE}\n{text}{changelog.removeprefix(TITLE)}"


def object_versions(version: str, digests: Mapping[str, str], before: bytes | None) -> str:
    """Return a table of objects and the release in which each Object File came to be as it is.

    Parameters
    ----------
    version
        The release.
    digests
        MD5 of each Object File by the id of its object.
    before
        The table of the release before.

    Examples
    --------
    >>> first = object_versions("v1", {"cup": "0a", "mug": "1b"}, None)
    >>> print(object_versions("v2", {"cup": "0a", "mug": "2c"}, first.encode()), end="")
    object,version,md5
    cup,v1,0a
    mug,v2,2c
    """
    rows = {row[OBJECT]: row for row in csv.DictReader(io.StringIO((before or b"").decode("utf-8")))}
    text = io.StringIO()
    writer = csv.DictWriter(text, (OBJECT, VERSION, DIGEST), lineterminator="\n")
    writer.writeheader()
    for object_id, digest in sorted(digests.items()):
        row = {OBJECT: object_id, VERSION: version, DIGEST: digest}
        earlier = rows.get(object_id, row)
        writer.writerow(earlier if earlier[DIGEST] == digest else row)
    return text.getvalue()
