"""Materials that the object's own name contradicts."""

import re
from collections.abc import Iterator, Mapping, Set

from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import WARNING, Finding

RULE = "material"

MEANT: Mapping[str, Set[str]] = {
    word: meant
    for meant, words in (
        (frozenset({"ceramic"}), "porcelain ceramic stoneware earthenware terracotta"),
        (frozenset({"glass"}), "glass"),
        (frozenset({"wood"}), "wood wooden bamboo plywood"),
        (frozenset({"plastic", "polycarbonate"}), "plastic polypropylene polyethylene abs pvc"),
        (frozenset({"steel", "iron"}), "steel stainless iron metal"),
        (frozenset(), "brass bronze aluminium aluminum rubber silicone cardboard"),
    )
    for word in words.split()
}
"""Words of names, and the materials of the factory's own table that they can mean; none where it has none."""


def check(entry: Entry, materials: Set[str]) -> Iterator[Finding]:
    """Find a material that the words of the id and name contradict; `materials` are those of the table."""
    material = entry.cell("material")
    # Words end at capitals, digits and signs: ``WoodenChair_01`` is wooden, chair.
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", entry.names)]
    said = {word: {word} & materials or MEANT[word] & materials for word in words if word in MEANT}
    possible = sorted(set().union(*said.values()))
    if not said or material in possible or material not in materials:
        return
    found = f"is {material}, where the name says {', '.join(said)}"
    if possible:
        remedy = f"Write {' or '.join(possible)}, or say in the notes why not and accept it"
    else:
        found += ", which the table of materials does not have"
        remedy = "Add a row to the table of materials, with its citation"
    yield entry.found(RULE, WARNING, "material", found, remedy)
