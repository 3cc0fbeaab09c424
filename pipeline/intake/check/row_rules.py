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
    word: materials
    for materials, words in (
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
        severity, finding = ERROR, entry.problem.finding
        if entry.is_unfetched:
            severity, finding = NOTE, "is not fetched: size, mass, walls and surface were not checked"
        yield entry.finding(READABLE, severity, column, finding, entry.problem.remedy)
    for column in NUMBERS:
        if entry.cell(column) and entry.number(column) is None:
            finding = f"{entry.cell(column)!r} is not a number above 0"
            yield entry.finding(READABLE, WARNING, column, finding, "Correct it, or leave it empty")


def check_licence(entry: Entry) -> Iterator[Finding]:
    """Find licences that are missing, not SPDX, not the source's, or that forbid what is made of it."""
    licence = entry.cell("licence")
    if not licence:
        remedy = "State its SPDX identifier, such as CC-BY-4.0"
        yield entry.finding(LICENCE, WARNING, "licence", "is empty", remedy)
        return
    identifier = spdx(licence) or likely_spdx(licence)
    if identifier != licence:
        remedy = (
            f"Write {identifier}"
            if identifier
            else "Use an identifier of spdx.org/licenses, or LicenseRef-NAME"
        )
        yield entry.finding(LICENCE, WARNING, "licence", f"{licence!r} is not as SPDX writes it", remedy)
    source = entry.source
    if source is not None and identifier is not None and identifier != source.licence:
        finding = f"{licence!r} is not the licence of {source.title}, {source.licence}"
        yield entry.finding(
            LICENCE, ERROR, "licence", finding, f"Write {source.licence}, or correct the source"
        )
    if "-ND" in (identifier or ""):
        finding = f"{identifier} does not allow changed versions, which an Object File is, to be shared"
        yield entry.finding(
            LICENCE, WARNING, "licence", finding, "Do not publish products of it, or ask its author"
        )
    elif "-NC" in (identifier or ""):
        finding = f"{identifier} allows no commercial use of its products"
        yield entry.finding(LICENCE, NOTE, "licence", finding, "Say so where the data set is published")


def check_provenance(entry: Entry) -> Iterator[Finding]:
    """Find rows whose provenance is missing or contradictory."""
    if not entry.cell("source"):
        yield entry.finding(PROVENANCE, WARNING, "source", "is empty", "Say where the mesh is from")
    if not entry.cell("attribution"):
        # The public domain asks for no name.
        severity = NOTE if entry.cell("licence").upper().startswith("CC0") else WARNING
        yield entry.finding(PROVENANCE, severity, "attribution", "is empty", "Say whom to name")
    source_id, in_words = entry.cell("source_id"), entry.source_in_words
    if not source_id:
        return
    try:
        source, name = source_and_name(source_id)
        source.check_name(name)
    except InputError as problem:
        finding = f"{source_id!r}: {problem.finding}"
        yield entry.finding(PROVENANCE, ERROR, "source_id", finding, problem.remedy)
        return
    if in_words not in (None, source):
        finding = f"{source_id!r} is of another source than {entry.cell('source')!r}"
        yield entry.finding(PROVENANCE, ERROR, "source_id", finding, "Correct the one or the other")


def check_material(entry: Entry) -> Iterator[Finding]:
    """Find a material that the words of the id and name contradict."""
    material, materials = entry.cell("material"), entry.materials.keys()
    # Words end at capitals, digits and signs: ``WoodenChair_01`` is wooden, chair.
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", entry.names)]
    meanings = {word: {word} & materials or MEANT[word] & materials for word in words if word in MEANT}
    possible = sorted(set().union(*meanings.values()))
    if not meanings or material in possible or material not in materials:
        return
    finding = f"is {material}, where the name says {', '.join(meanings)}"
    if possible:
        remedy = f"Write {' or '.join(possible)}, or say in the notes why not and accept it"
    else:
        finding += ", which the table of materials does not have"
        remedy = "Add a row to the table of materials, with its citation"
    yield entry.finding(MATERIAL, WARNING, "material", finding, remedy)
