"""Faults put into rows that are right, to count how many a check finds."""

import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from objectfolder.mesh.walls import WallMeasures
from pipeline.intake.check.duplicate_rule import RULE as DUPLICATE
from pipeline.intake.check.entry import NOTE, Entry, Shape
from pipeline.intake.check.mesh_rules import LENGTH, MASS
from pipeline.intake.check.row_rules import LICENCE, MATERIAL, PROVENANCE
from pipeline.intake.check.table_check import check_entries

SHORTEST_M, LONGEST_M = 0.003, 30.0
CLASSES = {"steel": "metal", "iron": "metal", "plastic": "plastic", "polycarbonate": "plastic"}
SIZE = (LENGTH, MASS)

Fault = Callable[[Entry], Entry | None]


def faults(seed: int) -> dict[str, tuple[Fault, tuple[str, ...]]]:
    """Return what is done to a row by name (None where it cannot be), and the rules that should doubt it."""
    return {
        "length x 10": (length(10), SIZE),
        "length x 0.1": (length(0.1), SIZE),
        "length x 25.4": (length(25.4), SIZE),
        "length x 1.1": (length(1.1), SIZE),
        "shortest side as length": (shortest_side, SIZE),
        "own mesh, length x 10": (own(length(10)), SIZE),
        "own mesh, length x 0.1": (own(length(0.1)), SIZE),
        "own mesh, shortest side": (own(shortest_side), SIZE),
        "another material": (another_material(seed), (MATERIAL, MASS)),
        "grams as kilograms": (mass(1000), (MASS,)),
        "pounds as kilograms": (mass(2.2046), (MASS,)),
        "no licence": (cell("licence", ""), (LICENCE,)),
        "licence of another": (cell("licence", "MIT"), (LICENCE,)),
        "no source": (cell("source", ""), (PROVENANCE,)),
    }


def injected(entries: Sequence[Entry], seed: int = 0) -> dict[str, Any]:
    """Return for each fault how many of the rows it was put into are doubted by the rules that should.

    A row that these rules doubt already, without the fault, is left out.
    """
    found: dict[str, Any] = {}
    before = {entry.object_id: doubting([entry]) for entry in entries}
    for name, (fault, rules) in faults(seed).items():
        changed = [
            row
            for entry in entries
            if not before[entry.object_id] & set(rules) and (row := fault(entry)) is not None
        ]
        hits = [row.object_id for row in changed if doubting([row]) & set(rules)]
        found[name] = {"rows": len(changed), "found": len(hits)}
    copies = [doubting([entry, copy_of(entry)]) for entry in entries]
    found["re-exported copy"] = {
        "rows": len(entries),
        "found": sum(DUPLICATE in rules for rules in copies),
    }
    return found


def doubting(entries: Sequence[Entry]) -> set[str]:
    """Names of the rules that have an error or a warning for rows."""
    return {one.rule for one in check_entries(entries).findings if one.severity != NOTE}


def length(factor: float) -> Fault:
    """Return the fault that states the length of a mesh in metres times a factor."""

    def put(entry: Entry) -> Entry | None:
        if entry.shape is None or entry.record is None:
            return None
        stated = entry.shape.file_length * factor
        if not SHORTEST_M <= stated <= LONGEST_M:
            return None  # the table itself is refused
        return replace(
            entry,
            cells={**entry.cells, "length_m": str(stated)},
            record=replace(entry.record, length_m=stated),
            shape=scaled(entry.shape, factor),
        )

    return put


def shortest_side(entry: Entry) -> Entry | None:
    """State the shortest side as the length; not for what is nearly a cube or a ball."""
    if entry.shape is None:
        return None
    share = min(entry.shape.file_extents) / entry.shape.file_length
    return None if share > 0.9 else length(share)(entry)


def own(fault: Fault) -> Fault:
    """Return a fault of a mesh of one's own, whose unit nobody knows."""

    def put(entry: Entry) -> Entry | None:
        row = fault(entry)
        return None if row is None else replace(row, cells={**row.cells, "source": "mine", "source_id": ""})

    return put


def another_material(seed: int) -> Fault:
    """Return the fault that draws a material of another class."""
    chance = random.Random(seed)

    def put(entry: Entry) -> Entry | None:
        right = CLASSES.get(entry.cell("material"), entry.cell("material"))
        drawn = chance.choice([name for name in entry.materials if CLASSES.get(name, name) != right])
        if entry.record is None:
            return None
        record = replace(entry.record, material=drawn)
        return replace(entry, cells={**entry.cells, "material": drawn}, record=record)

    return put


def mass(factor: float) -> Fault:
    """Return the fault that states the published mass times a factor."""

    def put(entry: Entry) -> Entry | None:
        published = entry.number("mass_kg")
        return None if published is None else cell("mass_kg", str(published * factor))(entry)

    return put


def cell(column: str, text: str) -> Fault:
    """Return the fault that writes a cell."""
    return lambda entry: replace(entry, cells={**entry.cells, column: text})


def copy_of(entry: Entry) -> Entry:
    """Return the same object under another id, in another file."""
    shape = None if entry.shape is None else replace(entry.shape, mesh_sha256="of another file")
    cells = {**entry.cells, "mesh": "copy.obj", "source_id": ""}
    return replace(entry, object_id=f"{entry.object_id}_copy", cells=cells, shape=shape)


def scaled(shape: Shape, factor: float) -> Shape:
    """Return a shape as if its mesh were scaled by a stated length."""
    values = shape.walls.to_dict()
    for unit, power in (("_m", 1), ("_m2", 2), ("_m3", 3)):
        for name in values:
            if name.endswith(unit) and values[name] is not None:
                values[name] *= factor**power
    return replace(shape, walls=WallMeasures(**values))
