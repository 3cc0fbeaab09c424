"""Materials that the name, the notes or the kind of thing contradict."""

from collections.abc import Iterator, Mapping, Set

from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import WARNING, Finding
from pipeline.intake.check.things import METALS, PLASTICS, thing_named
from pipeline.intake.check.words import affirmed, words_of

RULE = "material"

CERAMIC, GLASS, WOOD = frozenset({"ceramic"}), frozenset({"glass"}), frozenset({"wood"})
NONE: frozenset[str] = frozenset()

MEANT: Mapping[str, Set[str]] = {
    **dict.fromkeys(("porcelain", "ceramic", "ceramics", "stoneware", "earthenware", "terracotta"), CERAMIC),
    "glass": GLASS,
    **dict.fromkeys(("wood", "wooden", "bamboo", "plywood", "rubberwood"), WOOD),
    **dict.fromkeys(
        (
            "plastic", "plastics", "polycarbonate", "polypropylene", "polyethylene", "polystyrene", "hdpe",
            "abs", "pvc", "vinyl", "nylon", "acrylic", "melamine",
        ),
        PLASTICS,
    ),
    **dict.fromkeys(("steel", "stainless", "iron", "metal"), METALS),
    **dict.fromkeys(("brass", "bronze", "aluminium", "aluminum", "zinc", "pewter", "titanium"), NONE),
    **dict.fromkeys(("rubber", "silicone", "leather", "cork", "cardboard", "plush", "concrete"), NONE),
}  # fmt: skip
"""Words, and the materials of the factory's own table that they can mean; none where it has none such."""


def check(entry: Entry, materials: Set[str]) -> Iterator[Finding]:
    """Find materials that a row's own words contradict; `materials` are those of the table."""
    material = entry.cell("material")
    if material not in materials:
        return
    in_name = _said(words_of(entry.names), materials)
    in_notes = _said(words_of(affirmed(entry.cell("notes"))), materials)
    if in_name:
        yield from _contradicted(entry, in_name, "the name says")
    elif in_notes:
        yield from _contradicted(entry, in_notes, "the notes say")
    named = thing_named(words_of(entry.names))
    if named is None or in_name or any(material in meant for meant in in_notes.values()):
        return
    word, thing = named
    usual = None if thing.materials is None else sorted(thing.materials & materials)
    if usual and material not in usual:
        found = f"a {word} is hardly of {material}"
        yield entry.found(
            RULE, WARNING, "material", found, f"Likely {', '.join(usual)}, or say so in the notes"
        )


def _contradicted(entry: Entry, said: Mapping[str, Set[str]], where: str) -> Iterator[Finding]:
    material = entry.cell("material")
    if _fits(material, said):
        return
    words = ", ".join(said)
    possible = sorted(set().union(*said.values()))
    if possible:
        remedy = f"Write {' or '.join(possible)}, or say in the notes why not and accept it"
        yield entry.found(RULE, WARNING, "material", f"is {material}, where {where} {words}", remedy)
    else:
        found = f"is {material}, where {where} {words}, which the table of materials does not have"
        remedy = "Add a row to the table of materials, with its citation"
        yield entry.found(RULE, WARNING, "material", found, remedy)


def _said(words: tuple[str, ...], materials: Set[str]) -> dict[str, Set[str]]:
    """Words about materials, and what of the table each can mean."""
    said: dict[str, Set[str]] = {}
    for word in words:
        if word in MEANT:
            exact = {word} if word in materials and not MEANT[word] else set()
            said[word] = exact or MEANT[word] & materials
        elif word in materials:
            said[word] = {word}
    return said


def _fits(material: str, said: Mapping[str, Set[str]]) -> bool:
    return any(material in meant for meant in said.values())
