"""Rows that cannot be read, surfaces that are open, walls that a scan made wrong."""

from collections.abc import Iterator

from objectfolder.geometry.vessels import CERTAIN, HEAVIER, LIGHTER, LIKELY, wall_findings
from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import ERROR, NOTE, WARNING, Finding

READABLE, SURFACE, WALLS = "readable", "surface", "walls"

NUMBERS = ("mass_kg", "paper_length_m", "paper_index")
"""Columns of numbers above 0 that the factory itself passes over."""


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


def check_surface(entry: Entry) -> Iterator[Finding]:
    """Find surfaces that bound no solid: their volume and mass mean little."""
    if entry.shape is None or entry.shape.walls.closed:
        return
    topology = entry.shape.topology
    if topology.boundary_edges or topology.non_manifold_edges:
        found = (
            f"the surface is not closed: {topology.boundary_edges} boundary and "
            f"{topology.non_manifold_edges} non-manifold edges, {topology.components} pieces"
        )
    else:
        found = "the surface is closed but wound inconsistently, or bounds no positive volume"
    remedy = "Close it in an editor, or take its mass as that of the space that it mostly encloses"
    yield entry.found(SURFACE, WARNING, "mesh", found, remedy)


def check_walls(entry: Entry) -> Iterator[Finding]:
    """Find what `objectfolder.geometry.vessels` finds; masses are left to the rule `mass`."""
    if entry.shape is None or entry.record is None or entry.material is None:
        return
    for one in wall_findings(
        entry.shape.walls,
        material=entry.material.name,
        density_kg_m3=entry.material.density_kg_m3,
        mass_kg=entry.number("mass_kg"),
        words=entry.names,
        wall_m=entry.record.wall_m,
        shell_m=entry.record.shell_m,
    ):
        if one.kind not in (HEAVIER, LIGHTER):
            severity = WARNING if one.certainty in (CERTAIN, LIKELY) else NOTE
            found = f"{one.kind} ({one.certainty}): {one.finding}"
            yield entry.found(WALLS, severity, one.column or "mesh", found, one.remedy)
