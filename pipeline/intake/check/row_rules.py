"""Rules about what a row says: cells that cannot be read, licence, provenance, material by name."""

import re
from collections.abc import Iterator, Mapping, Set

from objectfolder.errors import InputError
from pipeline.intake.check.entry import ERROR, NOTE, WARNING, Entry, Finding
from pipeline.intake.check.spdx import likely_spdx, spdx
from pipeline.intake.sources.registry import source_and_name

READABLE, LICENCE, PROVENANCE, MATERIAL = "readable", "licence", "provenance", "material"

NUMBERS = ("paper_length_m", "paper_index")
"""Columns of numbers above 0 that the factory itself passes over."""

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


def check_readable(entry: Entry) -> Iterator[Finding]:
    """Find what keeps a row from being built; what is only not fetched yet is a note."""
    if entry.problem is not None:
        column = entry.problem.where.rpartition("field ")[2] if "field " in entry.problem.where else "mesh"
        severity, found = ERROR, entry.problem.finding
        if entry.is_unfetched:
            severity, found = NOTE, "is not fetched: size, mass, walls and surface were not checked"
        yield entry.found(READABLE, severity, column, found, entry.problem.remedy)
    for column in NUMBERS:
        if entry.cell(column) and entry.number(column) is None:
            found = f"{entry.cell(column)!r} is not a number above 0"
            yield entry.found(READABLE, WARNING, column, found, "Correct it, or leave it empty")


def check_licence(entry: Entry) -> Iterator[Finding]:
    """Find licences that are missing, not SPDX, not the source's, or that forbid what is made of it."""
    said = entry.cell("licence")
    if not said:
        remedy = "State its SPDX identifier, such as CC-BY-4.0"
        yield entry.found(LICENCE, WARNING, "licence", "is empty", remedy)
        return
    meant = spdx(said) or likely_spdx(said)
    if meant != said:
        remedy = f"Write {meant}" if meant else "Use an identifier of spdx.org/licenses, or LicenseRef-NAME"
        yield entry.found(LICENCE, WARNING, "licence", f"{said!r} is not as SPDX writes it", remedy)
    source = entry.source
    if source is not None and meant is not None and meant != source.licence:
        found = f"{said!r} is not the licence of {source.title}, {source.licence}"
        yield entry.found(LICENCE, ERROR, "licence", found, f"Write {source.licence}, or correct the source")
    if "-ND" in (meant or ""):
        found = f"{meant} does not allow changed versions, which an Object File is, to be shared"
        yield entry.found(
            LICENCE, WARNING, "licence", found, "Do not publish products of it, or ask its author"
        )
    elif "-NC" in (meant or ""):
        found = f"{meant} allows no commercial use of its products"
        yield entry.found(LICENCE, NOTE, "licence", found, "Say so where the data set is published")


def check_provenance(entry: Entry) -> Iterator[Finding]:
    """Find rows that do not say where they are from, or say so in two ways."""
    if not entry.cell("source"):
        yield entry.found(PROVENANCE, WARNING, "source", "is empty", "Say where the mesh is from")
    if not entry.cell("attribution"):
        # The public domain asks for no name.
        severity = NOTE if entry.cell("licence").upper().startswith("CC0") else WARNING
        yield entry.found(PROVENANCE, severity, "attribution", "is empty", "Say whom to name")
    source_id, in_words = entry.cell("source_id"), entry.source_in_words
    if not source_id:
        return
    try:
        source, name = source_and_name(source_id)
        source.check_name(name)
    except InputError as problem:
        found = f"{source_id!r}: {problem.finding}"
        yield entry.found(PROVENANCE, ERROR, "source_id", found, problem.remedy)
        return
    if in_words not in (None, source):
        found = f"{source_id!r} is of another source than {entry.cell('source')!r}"
        yield entry.found(PROVENANCE, ERROR, "source_id", found, "Correct the one or the other")


def check_material(entry: Entry) -> Iterator[Finding]:
    """Find a material that the words of the id and name contradict."""
    material, materials = entry.cell("material"), entry.materials.keys()
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
    yield entry.found(MATERIAL, WARNING, "material", found, remedy)
