"""What is doubtful about the size of an object before it is built: probably a mistake of unit."""

from typing import TYPE_CHECKING

import numpy as np

from objectfolder.errors import InputError
from pipeline.dataset.described_object import DescribedObject

if TYPE_CHECKING:
    from objectfolder.making.materials import Material
    from objectfolder.surface.textured_mesh import TexturedMesh

SMALL_M, LARGE_M, HEAVY_KG = 0.01, 1.0, 100.0
NORMALISED_M = (1.0, 2.0)
MASS_FACTOR = 20.0
"""Between a stated mass and that of the solid; thin vessels that were scanned solid stay below it."""


def size_doubts(mesh: "TexturedMesh", item: DescribedObject, material: "Material") -> list[str]:
    """Return what is doubtful about length and mass; the mass is that of the solid that the mesh bounds.

    A length that only the file states is doubtful from `LARGE_M` on and below `SMALL_M`; a mass is above
    `HEAVY_KG`, and a stated one beyond `MASS_FACTOR` times or below 1 / `MASS_FACTOR` of the solid's.

    Parameters
    ----------
    mesh
        Cleaned, of any scale where a length is stated.
    """
    extent = float(mesh.extents.max())
    length_m = item.length_m or extent
    # Seen from its middle, a mesh with holes bounds about its volume, too.
    corners = (mesh.vertices - mesh.vertices.mean(axis=0))[mesh.faces]
    volume = abs(float(np.linalg.det(corners).sum())) / 6 * (length_m / extent) ** 3
    solid_kg, stated_kg = material.density_kg_m3 * volume, item.mass_kg
    is_solid = item.shell_m is None and item.wall_m is None
    doubts = []
    if item.length_m is None and not SMALL_M <= extent < LARGE_M:
        is_unit = any(abs(extent - number) <= 1e-6 * number for number in NORMALISED_M)
        doubts.append(f"{extent:.4g} m long by the file{', as if normalised' if is_unit else ''}")
    mass_kg = stated_kg or (solid_kg if item.shell_m is None else 0.0)
    if stated_kg and is_solid and not 1 / MASS_FACTOR <= solid_kg / stated_kg <= MASS_FACTOR:
        doubts.append(f"{stated_kg:.3g} kg stated, where a solid of {material.name} has {solid_kg:.3g} kg")
    elif mass_kg > HEAVY_KG:
        doubts.append(f"{mass_kg:.0f} kg of {material.name}")
    return doubts


def clean_mesh(item: DescribedObject) -> "TexturedMesh":
    """Return the mesh of an object cleaned, in the units of its file, without colours."""
    from objectfolder.making.mesh.cleaning import clean
    from objectfolder.making.mesh.readers.load import load_mesh

    return clean(load_mesh(item.mesh, with_textures=False, up=item.up), str(item.mesh))[0]


COMMAND = ("--length", "--mass", "--material", "--yes")
CALL = ("length_m", "mass_kg", "material", "any_size=True")
"""What states length, mass and material of a build, and that any size is meant."""


def refuse_doubtful_size(
    item: DescribedObject, material: "Material", words: tuple[str, str, str, str]
) -> None:
    """Raise `InputError` where size or mass is doubtful, or where pieces decide the size.

    Parameters
    ----------
    words
        `COMMAND` or `CALL`, by which the remedy names what to give.
    """
    from objectfolder.making.mesh.ingest import debris

    mesh = clean_mesh(item)
    if not (doubts := [*debris(mesh), *size_doubts(mesh, item, material)]):
        return
    length, mass, of_material, any_size = words
    remedy = f"Correct {length} or {of_material}"
    if item.mass_kg is not None:
        remedy = f"Correct {mass}, {length} or {of_material}"
    elif item.length_m is None:
        remedy = f"State {length} in metres"
    raise InputError(str(item.mesh), "; ".join(doubts), f"{remedy}, or give {any_size}.")
