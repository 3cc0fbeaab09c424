"""Where an object is from: source, attribution, addresses."""

import difflib
from collections.abc import Iterator

from pipeline.checking.entry import Entry
from pipeline.checking.finding import ERROR, NOTE, WARNING, Finding
from pipeline.checking.sources import SOURCES, source_of

RULE = "provenance"


def check(entry: Entry) -> Iterator[Finding]:
    """Find rows that do not say where they are from, or say so in two ways."""
    if not entry.cell("source"):
        yield entry.found(RULE, WARNING, "source", "is empty", "Say where the mesh is from")
    if not entry.cell("attribution"):
        # The public domain asks for no name.
        severity = NOTE if entry.cell("licence").upper().startswith("CC0") else WARNING
        yield entry.found(RULE, severity, "attribution", "is empty", "Say whom to name")
    yield from _source_id(entry)
    source, address = source_of(entry), entry.cell("source_url")
    if source is None or not address:
        return
    dead = next((host for host in source.dead if host in address), None)
    if dead is not None:
        found = f"{dead} no longer answers"
        yield entry.found(RULE, WARNING, "source_url", found, f"Use today's address, with {source.address}")
    elif "://" not in address:
        found = f"{address!r} is no address"
        yield entry.found(RULE, WARNING, "source_url", found, "Write it whole, with https://")


def _source_id(entry: Entry) -> Iterator[Finding]:
    source_id = entry.cell("source_id")
    if not source_id:
        return
    prefix, colon, name = source_id.partition(":")
    known = [source.prefix for source in SOURCES]
    if not colon or not name or prefix not in known:
        near = difflib.get_close_matches(prefix.lower(), known, 1)
        hint = f"Did you mean {near[0]}:{name or 'NAME'}? " if near else ""
        remedy = f"{hint}Write {' or '.join(f'{one}:NAME' for one in known)}"
        yield entry.found(RULE, ERROR, "source_id", f"{source_id!r} names no known source", remedy)
        return
    said = entry.cell("source").lower()
    named = [source for source in SOURCES if any(word in said for word in source.words)]
    if named and prefix not in [source.prefix for source in named]:
        found = f"{source_id!r} is of another source than {entry.cell('source')!r}"
        yield entry.found(RULE, ERROR, "source_id", found, "Correct the one or the other")
