"""Where an object is from: source, attribution, addresses."""

from collections.abc import Iterator

from objectfolder.errors import InputError
from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import ERROR, NOTE, WARNING, Finding
from pipeline.intake.sources.registry import SOURCES, source_and_name
from pipeline.intake.sources.source import Source

RULE = "provenance"

NAMES = {
    "ycb": ("ycb",),
    "gso": ("google scanned", "gso", "scanned objects by google"),
    "polyhaven": ("poly haven", "polyhaven", "3d model haven", "3dmodelhaven"),
}
"""By the id of a source, texts that name it in the column `source`, in small letters."""

MOVED = {
    "fuel.ignitionrobotics.org": "gazebosim.org",
    "app.ignitionrobotics.org": "gazebosim.org",
    "3dmodelhaven.com": "polyhaven.com/a/",
}
"""Addresses that no longer answer, and where their content is now."""


def check(entry: Entry) -> Iterator[Finding]:
    """Find rows that do not say where they are from, or say so in two ways."""
    if not entry.cell("source"):
        yield entry.found(RULE, WARNING, "source", "is empty", "Say where the mesh is from")
    if not entry.cell("attribution"):
        # The public domain asks for no name.
        severity = NOTE if entry.cell("licence").upper().startswith("CC0") else WARNING
        yield entry.found(RULE, severity, "attribution", "is empty", "Say whom to name")
    yield from _source_id(entry)
    address = entry.cell("source_url")
    for old, new in MOVED.items():
        if old in address:
            found = f"{old} no longer answers"
            yield entry.found(RULE, WARNING, "source_url", found, f"Use today's address, with {new}")
    if address and "://" not in address:
        found = f"{address!r} is no address"
        yield entry.found(RULE, WARNING, "source_url", found, "Write it whole, with https://")


def source_of(entry: Entry) -> Source | None:
    """Return the public source that a row names, by its source_id or in words; None for one's own."""
    prefix, colon, _ = entry.cell("source_id").partition(":")
    if colon:
        return SOURCES.get(prefix)
    return next(iter(_sources_named(entry.cell("source"))), None)


def _sources_named(said: str) -> list[Source]:
    return [SOURCES[one] for one, names in NAMES.items() if any(name in said.lower() for name in names)]


def _source_id(entry: Entry) -> Iterator[Finding]:
    source_id = entry.cell("source_id")
    if not source_id:
        return
    try:
        source, name = source_and_name(source_id)
        source.check_name(name)
    except InputError as problem:
        yield entry.found(RULE, ERROR, "source_id", f"{source_id!r}: {problem.finding}", problem.remedy)
        return
    named = _sources_named(entry.cell("source"))
    if named and source not in named:
        found = f"{source_id!r} is of another source than {entry.cell('source')!r}"
        yield entry.found(RULE, ERROR, "source_id", found, "Correct the one or the other")
