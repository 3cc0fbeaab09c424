"""Looks that contradict the material."""

from collections.abc import Iterator

from objectfolder.audio.materials import Material
from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import NOTE, WARNING, Finding
from pipeline.intake.check.words import affirmed, words_of

RULE = "looks"

COVERED = frozenset(
    {
        "enamel", "enameled", "enamelled", "lacquered", "painted", "powder", "coated", "varnished",
        "anodized", "anodised",
    }
)  # fmt: skip
METALLISED = frozenset(
    {
        "chrome", "chromed", "metallised", "metallized", "metallic", "gold", "golden", "silver", "foil",
        "plated",
    }
)  # fmt: skip
MATT = frozenset({"matt", "matte", "rubber", "rubberised", "felt", "unglazed"})
SHINY = frozenset({"mirror", "polished", "chrome", "chromed", "glossy", "shiny"})


def check(entry: Entry) -> Iterator[Finding]:
    """Find metallic and roughness that what the row says contradicts."""
    words = frozenset(words_of(f"{entry.names} {affirmed(entry.cell('notes'))}"))
    if entry.material is not None:
        yield from _metallic(entry, entry.material, words)
    roughness = entry.fraction("roughness")
    if roughness is None:
        return
    for said, contradicts, limit in (
        (MATT, roughness < 0.3, "above 0.3"),
        (SHINY, roughness > 0.7, "below 0.7"),
    ):
        if contradicts and words & said and not (words & MATT and words & SHINY):
            found = f"{roughness:g}, where the row says {', '.join(sorted(words & said))}"
            yield entry.found(RULE, WARNING, "roughness", found, f"State one {limit}")


def _metallic(entry: Entry, material: Material, words: frozenset[str]) -> Iterator[Finding]:
    stated, name = entry.fraction("metallic"), material.name
    is_metal = material.metallic >= 0.5
    if stated is None:
        if is_metal and words & COVERED:
            found = f"{name} is drawn as bare metal, where the row says {', '.join(sorted(words & COVERED))}"
            yield entry.found(RULE, NOTE, "metallic", found, "State metallic 0 for what is covered all over")
    elif is_metal and stated < 0.5 and not words & COVERED:
        found = f"{stated:g} for {name}, which is a metal"
        yield entry.found(RULE, WARNING, "metallic", found, "State 1, or say in the notes what covers it")
    elif not is_metal and stated >= 0.5 and not words & METALLISED:
        found = f"{stated:g} for {name}, which is no metal"
        yield entry.found(RULE, WARNING, "metallic", found, "State 0, or say in the notes what covers it")
