"""Where an object is from: source, attribution, addresses."""

from collections.abc import Iterator

from objectfolder.errors import InputError
from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import ERROR, NOTE, WARNING, Finding
from pipeline.intake.check.known_source import ADDRESSES, source_of, sources_named
from pipeline.intake.sources.registry import source_and_name

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
    known = ADDRESSES[source.id]
    dead = next((host for host in known.dead if host in address), None)
    if dead is not None:
        found = f"{dead} no longer answers"
        yield entry.found(RULE, WARNING, "source_url", found, f"Use today's address, with {known.today}")
    elif "://" not in address:
        found = f"{address!r} is no address"
        yield entry.found(RULE, WARNING, "source_url", found, "Write it whole, with https://")


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
    named = sources_named(entry.cell("source"))
    if named and source not in named:
        found = f"{source_id!r} is of another source than {entry.cell('source')!r}"
        yield entry.found(RULE, ERROR, "source_id", found, "Correct the one or the other")
