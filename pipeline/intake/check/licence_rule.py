"""Licences: as SPDX writes them, right for the source and for what is made."""

import re
from collections.abc import Iterator

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import ERROR, NOTE, WARNING, Finding
from pipeline.intake.check.provenance_rule import source_of

RULE = "licence"

COMMON_NAMES = {
    "creative commons": "cc", "attribution": "by", "share ?alike": "sa", "non-? ?commercial": "nc",
    "no-? ?derivatives": "nd", r"universal|international|public domain|licen[cs]e|zero|[(),]": " ",
}  # fmt: skip
"""Parts of names of Creative Commons licences, as patterns, and those of their identifiers."""


def check(entry: Entry) -> Iterator[Finding]:
    """Find licences that are missing, not SPDX, not the source's, or that forbid what is made of it."""
    said = entry.cell("licence")
    if not said:
        remedy = "State its SPDX identifier, such as CC-BY-4.0"
        yield entry.found(RULE, WARNING, "licence", "is empty", remedy)
        return
    meant = spdx(said) or likely_spdx(said)
    if meant != said:
        remedy = f"Write {meant}" if meant else "Use an identifier of spdx.org/licenses, or LicenseRef-NAME"
        yield entry.found(RULE, WARNING, "licence", f"{said!r} is not as SPDX writes it", remedy)
    source = source_of(entry)
    if source is not None and meant is not None and meant != source.licence:
        found = f"{said!r} is not the licence of {source.title}, {source.licence}"
        yield entry.found(RULE, ERROR, "licence", found, f"Write {source.licence}, or correct the source")
    if "-ND" in (meant or ""):
        found = f"{meant} does not allow changed versions, which an Object File is, to be shared"
        yield entry.found(RULE, WARNING, "licence", found, "Do not publish products of it, or ask its author")
    elif "-NC" in (meant or ""):
        found = f"{meant} allows no commercial use of its products"
        yield entry.found(RULE, NOTE, "licence", found, "Say so where the data set is published")


def spdx(licence: str) -> str | None:
    """Return a licence expression as SPDX writes it; None for what is none."""
    try:
        return str(canonicalize_license_expression(licence))
    except InvalidLicenseExpression:
        return None


def likely_spdx(licence: str) -> str | None:
    """Return what a common way to write a Creative Commons licence means; None where it means none."""
    text = licence.lower()
    for pattern, part in COMMON_NAMES.items():
        text = re.sub(pattern, part, text)
    text = "-".join(re.split(r"[\s-]+", text.strip()))
    if not re.search(r"\d\.\d", text):
        text += "-1.0" if text == "cc0" else "-4.0"
    return spdx(text)
