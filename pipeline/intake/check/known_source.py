"""What a row says of the public source it is from."""

from dataclasses import dataclass

from pipeline.intake.check.entry import Entry
from pipeline.intake.sources.registry import SOURCES
from pipeline.intake.sources.source import Source


@dataclass(frozen=True)
class Address:
    """Where people say a source is.

    Parameters
    ----------
    words
        Any of which, in small letters, names it in the column `source`.
    today
        What its addresses contain.
    dead
        Addresses that no longer answer.
    """

    words: tuple[str, ...]
    today: str
    dead: tuple[str, ...] = ()


ADDRESSES = {
    "ycb": Address(("ycb",), "ycb-benchmarks.s3"),
    "gso": Address(
        ("google scanned", "gso", "scanned objects by google"),
        "gazebosim.org",
        ("fuel.ignitionrobotics.org", "app.ignitionrobotics.org"),
    ),
    "polyhaven": Address(
        ("poly haven", "polyhaven", "3d model haven", "3dmodelhaven"),
        "polyhaven.com/a/",
        ("3dmodelhaven.com",),
    ),
}
"""By the id of a source."""


def source_of(entry: Entry) -> Source | None:
    """Return the public source that a row names, by its source_id or in words; None for one's own."""
    prefix, colon, _ = entry.cell("source_id").partition(":")
    if colon:
        return SOURCES.get(prefix)
    named = sources_named(entry.cell("source"))
    return named[0] if named else None


def sources_named(said: str) -> list[Source]:
    """Return the public sources that the text of a column `source` may mean."""
    text = said.lower()
    return [SOURCES[one] for one, address in ADDRESSES.items() if any(word in text for word in address.words)]


def is_metric(entry: Entry) -> bool:
    """Whether the mesh comes from a public source: the meshes of all of them are in metres."""
    return source_of(entry) is not None
