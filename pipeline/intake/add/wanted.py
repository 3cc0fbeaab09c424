"""The description of an object to add to a table; light to import."""

from dataclasses import KW_ONLY, dataclass
from pathlib import Path

from pipeline.dataset.project_files import MATERIALS


@dataclass(frozen=True)
class Wanted:
    """An object to add, as its owner describes it; None where the files tell.

    Parameters
    ----------
    mesh
        OBJ, glTF, GLB, PLY or STL
    material
        a row of the materials table
    licence
        SPDX identifier, such as CC-BY-4.0 or CC0-1.0
    materials
        materials table (CSV)
    attribution
        whom to name (needed except for CC0-1.0 and similar licences)
    length_m
        longest side in metres (default: as in the file)
    object_id
        identifier (default: from the name of the file)
    name
        name in words (default: from the identifier)
    texture
        base colour image (default: the mesh's own)
    source
        where the mesh is from
    wall_m
        least thickness of walls, metres, where too thin
    shell_m
        wall of a container that was scanned solid, metres
    roughness
        0..1 (default: the material's)
    metallic
        0..1 (default: the material's)
    mass_kg
        mass in kilograms where it is known: a check
    """

    mesh: Path
    _: KW_ONLY
    material: str
    licence: str
    materials: Path = MATERIALS
    attribution: str | None = None
    length_m: float | None = None
    object_id: str | None = None
    name: str | None = None
    texture: Path | None = None
    source: str = ""
    wall_m: float | None = None
    shell_m: float | None = None
    roughness: float | None = None
    metallic: float | None = None
    mass_kg: float | None = None
