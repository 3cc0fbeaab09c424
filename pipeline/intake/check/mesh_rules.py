"""Rules about what was measured on a mesh: its length, mass, surface and walls."""

from collections.abc import Iterator

from objectfolder.making.mesh.cleaning import NESTED_REMEDY
from objectfolder.making.mesh.walls import CERTAIN, HEAVIER, LIGHTER, LIKELY, wall_findings
from pipeline.intake.check.entry import ERROR, NOTE, WARNING, Entry, Finding, Shape

LENGTH, MASS, SURFACE, WALLS, LOOKS = "length", "mass", "surface", "walls", "looks"

SAME = 0.03
"""Relative difference within which two lengths of a scan are the same."""

DOUBTFUL_FACTOR = 2.0
"""Scans of thin walls are up to this much too thick; wood of one class varies as much."""
ABSURD_FACTOR = 20.0
NEAR = 1.35
"""Factor within which a density is near that of a material."""

HELD_M, HELD_KG = 0.5, 5.0
"""A solid block of wood of that length weighs as much; what is held does not."""
HEAVIEST_KG, LIGHTEST_KG = 200.0, 0.002

SHELL = "shell_m"
"""Column that makes a solid hollow."""


def check_length(entry: Entry) -> Iterator[Finding]:
    """Find slips of unit, lengths of another side, and what differs from the paper's."""
    if entry.record is None or entry.shape is None:
        return
    statement_m = entry.record.length_m
    if statement_m is not None:
        yield from _against_mesh(entry, entry.shape, statement_m)
    length_m, papers = entry.shape.length_m, entry.number("paper_length_m")
    if papers is not None and not is_close(papers / length_m, 1):
        finding = (
            f"{length_m:.4g} m, where the paper has {papers:.4g} m ({papers / length_m:.3g} times as long)"
        )
        severity, remedy = WARNING, "Say in the notes why"
        if entry.cell("notes"):
            severity, remedy = NOTE, "The notes should say why"
        yield entry.finding(LENGTH, severity, "paper_length_m", finding, remedy)


def _against_mesh(entry: Entry, shape: Shape, statement_m: float) -> Iterator[Finding]:
    side = shape.file_length
    factor = statement_m / side
    if is_close(factor, 1):
        return
    statement = (
        f"the stated {statement_m:.4g} m is {factor:.3g} times the longest side of the mesh, {side:.4g}"
    )
    for extent, axis in sorted(zip(shape.file_extents, "xyz", strict=True), reverse=True)[1:]:
        if is_close(statement_m / extent, 1) and not is_close(side / extent, 1):
            finding = f"{statement}; it is the side along {axis} ({extent:.4g})"
            remedy = f"Give the longest side ({side:.4g}), or 'as in file'"
            yield entry.finding(LENGTH, WARNING, "length_m", finding, remedy)
            return
    # A mesh of one's own may be in any unit; those of all public sources are in metres.
    if entry.source is not None:
        severity = ERROR if not 1 / 3 <= factor <= 3 else WARNING
        remedy = f"Write {side:.4g}, or 'as in file'"
        yield entry.finding(LENGTH, severity, "length_m", f"{statement}, which is in metres", remedy)


def is_close(ratio: float, reference: float) -> bool:
    """Whether a ratio equals a reference, within the difference of two scans of one object."""
    return abs(ratio / reference - 1) <= SAME


def check_mass(entry: Entry) -> Iterator[Finding]:
    """Find masses that contradict the published one, or that nothing of that size has."""
    mass, table_kg = mass_as_made(entry), entry.number("mass_kg")
    if mass is None or entry.shape is None:
        return
    if table_kg is not None:
        yield from _against_published(entry, mass, table_kg, entry.shape.length_m)
        return
    length_m = entry.shape.length_m
    too_heavy = length_m <= HELD_M and mass > HELD_KG
    if too_heavy or not LIGHTEST_KG <= mass <= HEAVIEST_KG:
        finding = f"density times volume is {kilograms(mass)} at a length of {length_m:.3g} m"
        remedy = "If it is hollow, set shell_m; if not, check the length, its unit and the material"
        yield entry.finding(MASS, WARNING, SHELL if too_heavy else "length_m", finding, remedy)


def mass_as_made(entry: Entry) -> float | None:
    """Return the mass in kilograms as made, of the shell if one is stated; None for open surfaces."""
    if entry.shape is None or entry.material is None or not entry.shape.walls.closed:
        return None
    walls, shell_m = entry.shape.walls, entry.record.shell_m if entry.record else None
    volume = walls.volume_m3 if shell_m is None else min(walls.volume_m3, walls.area_m2 * shell_m)
    return volume * entry.material.density_kg_m3


def _against_published(entry: Entry, mass: float, table_kg: float, length_m: float) -> Iterator[Finding]:
    factor, material = mass / table_kg, entry.material
    if material is None or 1 / DOUBTFUL_FACTOR <= factor <= DOUBTFUL_FACTOR:
        return
    fitting = material.density_kg_m3 / factor
    near = [
        candidate.name
        for candidate in entry.materials.values()
        if 1 / NEAR <= fitting / candidate.density_kg_m3 <= NEAR
    ]
    finding = (
        f"density times volume is {kilograms(mass)}, {factor:.2g} times the "
        f"published {kilograms(table_kg)}; {material.name} has {material.density_kg_m3:.0f} kg/m3, "
        f"{fitting:.0f} would fit"
    )
    if near:
        finding += f", near {' and '.join(near)}"
    if factor > 1:
        remedy = "It is hollow or scanned too thick (shell_m), or not of this material"
    else:
        remedy = "Parts are missing from the scan or too thin (wall_m), or it is not of this material"
    absurd = not 1 / ABSURD_FACTOR <= factor <= ABSURD_FACTOR
    if absurd:
        fitting_m = length_m / factor ** (1 / 3)
        remedy += f"; a length of {fitting_m:.3g} m instead of {length_m:.3g} m would explain it"
    yield entry.finding(MASS, ERROR if absurd else WARNING, "mass_kg", finding, remedy)


def kilograms(mass_kg: float) -> str:
    """Return a mass as text, in grams below one kilogram."""
    return f"{mass_kg:.3g} kg" if mass_kg >= 1 else f"{1e3 * mass_kg:.3g} g"


def check_surface(entry: Entry) -> Iterator[Finding]:
    """Find surfaces that bound no solid, or another solid than they seem to: their mass means little."""
    if entry.shape is None:
        return
    topology, cleaning = entry.shape.topology, entry.shape.cleaning
    if cleaning is not None and cleaning.nested_solids:
        yield entry.finding(SURFACE, WARNING, "mesh", cleaning.nested_finding(), NESTED_REMEDY)
    if cleaning is not None and cleaning.doubled_faces_dropped:
        finding = f"{cleaning.doubled_faces_dropped} faces lie back to back with others and are left out"
        yield entry.finding(SURFACE, NOTE, "mesh", finding, "Export one layer of faces")
    if entry.shape.walls.closed:
        return
    if entry.shape.walls.cracked:
        finding = f"the surface is closed but for cracks ({topology.boundary_edges} boundary edges)"
        yield entry.finding(SURFACE, NOTE, "mesh", finding, "Join its parts in an editor for an exact volume")
        return
    if topology.boundary_edges or topology.non_manifold_edges:
        finding = (
            f"the surface is not closed: {topology.boundary_edges} boundary and "
            f"{topology.non_manifold_edges} non-manifold edges, {topology.components} pieces"
        )
    else:
        finding = "the surface is closed but wound inconsistently, or bounds no positive volume"
    remedy = "Close it in an editor, or take its mass as that of the space that it mostly encloses"
    yield entry.finding(SURFACE, WARNING, "mesh", finding, remedy)


def check_looks(entry: Entry) -> Iterator[Finding]:
    """Find what a reader interpreted otherwise than the file states."""
    for remark in entry.shape.remarks if entry.shape else ():
        yield entry.finding(LOOKS, WARNING, "mesh", remark, "Look at the picture that `add` draws")


def check_walls(entry: Entry) -> Iterator[Finding]:
    """Find what `objectfolder.making.mesh.walls` finds; masses are left to the rule `mass`."""
    if entry.shape is None or entry.record is None or entry.material is None:
        return
    for wall in wall_findings(
        entry.shape.walls,
        material=entry.material.name,
        density_kg_m3=entry.material.density_kg_m3,
        mass_kg=entry.number("mass_kg"),
        wall_m=entry.record.wall_m,
        shell_m=entry.record.shell_m,
    ):
        if wall.kind not in (HEAVIER, LIGHTER):
            severity = WARNING if wall.certainty in (CERTAIN, LIKELY) else NOTE
            finding = f"{wall.kind} ({wall.certainty}): {wall.finding}"
            yield entry.finding(WALLS, severity, wall.column, finding, wall.remedy)
