"""What is known of public sources of meshes: licence, unit, addresses."""

from dataclasses import dataclass

from pipeline.checking.entry import Entry


@dataclass(frozen=True)
class PublicSource:
    """A collection that publishes meshes in metres.

    Parameters
    ----------
    prefix
        Of its `source_id`.
    title
        As the column `source` should say.
    words
        Any of which, in small letters, names it in the column `source`.
    licence
        SPDX identifier of its terms.
    address
        What its addresses contain today.
    dead
        Addresses that no longer answer.
    """

    prefix: str
    title: str
    words: tuple[str, ...]
    licence: str
    address: str
    dead: tuple[str, ...] = ()


SOURCES = (
    PublicSource("ycb", "YCB Object and Model Set", ("ycb",), "CC-BY-4.0", "ycb-benchmarks.s3"),
    PublicSource(
        "gso",
        "Google Scanned Objects",
        ("google scanned", "gso", "scanned objects by google"),
        "CC-BY-4.0",
        "fuel.gazebosim.org",
        ("fuel.ignitionrobotics.org", "app.ignitionrobotics.org"),
    ),
    PublicSource(
        "polyhaven",
        "Poly Haven",
        ("poly haven", "polyhaven", "3d model haven", "3dmodelhaven"),
        "CC0-1.0",
        "polyhaven.com/a/",
        ("3dmodelhaven.com",),
    ),
)


def source_of(entry: Entry) -> PublicSource | None:
    """Return the public source that a row names, by its source_id or in words; None for one's own."""
    prefix = entry.cell("source_id").partition(":")[0]
    said = entry.cell("source").lower()
    for source in SOURCES:
        if prefix == source.prefix or (not prefix and any(word in said for word in source.words)):
            return source
    return None


def is_metric(entry: Entry) -> bool:
    """Whether the mesh comes from a source whose meshes are in metres."""
    return source_of(entry) is not None
