"""Licences: stated, as SPDX writes them, and fit for the source and for what is made."""

import re
from collections.abc import Iterator

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import ERROR, NOTE, WARNING, Finding
from pipeline.intake.check.known_source import source_of

RULE = "licence"

_VERSION = re.compile(r"\d+\.\d+")


def check(entry: Entry) -> Iterator[Finding]:
    """Find licences that are missing, not SPDX, not the source's, or that forbid what is made of it."""
    said = entry.cell("licence")
    if not said:
        yield entry.found(
            RULE, WARNING, "licence", "is empty", "State its SPDX identifier, such as CC-BY-4.0"
        )
        return
    canonical = spdx(said)
    if canonical != said:
        likely = canonical or spdx(guess(said))
        found = f"{said!r} is not as SPDX writes it"
        remedy = f"Write {likely}" if likely else "Use an identifier of spdx.org/licenses, or LicenseRef-NAME"
        yield entry.found(RULE, WARNING, "licence", found, remedy)
    meant = canonical or spdx(guess(said))
    source = source_of(entry)
    if source is not None and meant is not None and meant != source.licence:
        found = f"{said!r} is not the licence of {source.title}, {source.licence}"
        yield entry.found(RULE, ERROR, "licence", found, f"Write {source.licence}, or correct the source")
    yield from _forbids(entry, meant or "")


def _forbids(entry: Entry, licence: str) -> Iterator[Finding]:
    if "-ND" in licence:
        found = f"{licence} does not allow changed versions, which an Object File is, to be shared"
        yield entry.found(RULE, WARNING, "licence", found, "Keep what is made of it to yourself, or ask")
    elif "-NC" in licence:
        found = f"{licence} allows no commercial use of what is made of it"
        yield entry.found(RULE, NOTE, "licence", found, "Say so where the data set is published")


def spdx(licence: str) -> str | None:
    """Return a licence expression as SPDX writes it; None for what is none."""
    try:
        return str(canonicalize_license_expression(licence))
    except InvalidLicenseExpression:
        return None


def guess(licence: str) -> str:
    """Return what the common ways to write a Creative Commons licence mean."""
    text = re.sub(r"creative commons|cc0?\b[^\w]*by", _short, licence, flags=re.IGNORECASE)
    text = re.sub(r"\battribution\b", "by", text, flags=re.IGNORECASE)
    text = re.sub(r"\bshare ?alike\b", "sa", text, flags=re.IGNORECASE)
    text = re.sub(r"\bnon-? ?commercial\b", "nc", text, flags=re.IGNORECASE)
    text = re.sub(r"\bno-? ?derivatives\b", "nd", text, flags=re.IGNORECASE)
    text = re.sub(r"\b(universal|international|public domain|licen[cs]e|zero)\b|[()]", " ", text, flags=re.I)
    text = "-".join(part for part in re.split(r"[\s,-]+", text) if part)
    if not _VERSION.search(text):
        text += "-1.0" if text.lower() == "cc0" else "-4.0" if text.lower().startswith("cc-by") else ""
    return text


def _short(match: re.Match[str]) -> str:
    return "cc" if match[0].lower().startswith("creative") else "cc-by"
