"""Masses: density times volume against what is published, and against what things of that size weigh."""

from collections.abc import Iterable, Iterator, Mapping

from objectfolder.audio.materials import Material
from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import ERROR, NOTE, WARNING, Finding

RULE = "mass"

DOUBTFUL_FACTOR = 2.0
"""Scans of thin walls are up to this much too thick; wood of one class varies as much."""

ABSURD_FACTOR = 20.0

NEAR = 1.35
"""Factor within which a density is near that of a material."""

HELD_M = 0.5
HELD_KG = 5.0
"""A solid block of wood of that length weighs as much; what is held does not."""

HEAVIEST_KG = 200.0

SHELL = "shell_m"
"""Column that makes a solid hollow."""


def check(entry: Entry, known: Mapping[str, Material]) -> Iterator[Finding]:
    """Find masses that contradict the published one, or that nothing of that size has.

    Parameters
    ----------
    known
        The table of materials, to say which would fit.
    """
    published = entry.number("mass_kg")
    if published is not None and not entry.cell("mass_source"):
        yield entry.found(RULE, NOTE, "mass_source", "is empty beside mass_kg", "Say who published the mass")
    mass = mass_as_made(entry)
    if mass is None or entry.shape is None or entry.material is None:
        return
    if published is not None:
        yield from _against_published(
            entry, entry.material, mass, published, entry.shape.length_m, known.values()
        )
    else:
        yield from _against_size(entry, mass, entry.shape.length_m)


def mass_as_made(entry: Entry) -> float | None:
    """Kilograms of what would sound, of its shell where the row states one; None for open surfaces."""
    if entry.shape is None or entry.material is None or not entry.shape.walls.closed:
        return None
    walls, shell_m = entry.shape.walls, entry.record.shell_m if entry.record else None
    volume = walls.volume_m3 if shell_m is None else min(walls.volume_m3, walls.area_m2 * shell_m)
    return volume * entry.material.density_kg_m3


def _against_published(
    entry: Entry,
    material: Material,
    mass: float,
    published: float,
    length_m: float,
    known: Iterable[Material],
) -> Iterator[Finding]:
    factor = mass / published
    if 1 / DOUBTFUL_FACTOR <= factor <= DOUBTFUL_FACTOR:
        return
    fitting = material.density_kg_m3 / factor
    near = [one.name for one in known if 1 / NEAR <= fitting / one.density_kg_m3 <= NEAR]
    found = (
        f"density times volume is {kilograms(mass)}, {factor:.2g} times the "
        f"published {kilograms(published)}; {material.name} has {material.density_kg_m3:.0f} kg/m3, "
        f"{fitting:.0f} would fit"
    )
    if near:
        found += f", near {' and '.join(near)}"
    if factor > 1:
        remedy = "It is hollow or scanned too thick (shell_m), or not of this material"
    else:
        remedy = "Parts are missing from the scan or too thin (wall_m), or it is not of this material"
    absurd = not 1 / ABSURD_FACTOR <= factor <= ABSURD_FACTOR
    if absurd:
        fitting_m = length_m / factor ** (1 / 3)
        remedy += f"; a length of {fitting_m:.3g} m instead of {length_m:.3g} m would explain it"
    yield entry.found(RULE, ERROR if absurd else WARNING, "mass_kg", found, remedy)


def _against_size(entry: Entry, mass: float, length_m: float) -> Iterator[Finding]:
    held = length_m <= HELD_M and mass > HELD_KG
    if held or mass > HEAVIEST_KG:
        found = f"density times volume is {kilograms(mass)} at a length of {length_m:.3g} m"
        remedy = "If it is hollow, set shell_m; if not, check the length and the material"
        yield entry.found(RULE, WARNING, SHELL if held else "length_m", found, remedy)


def kilograms(mass_kg: float) -> str:
    """Return a mass as text, in grams below one kilogram."""
    return f"{mass_kg:.3g} kg" if mass_kg >= 1 else f"{1e3 * mass_kg:.3g} g"
