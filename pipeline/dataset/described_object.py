"""An object as its owner describes it, for one Object File or a row of a table; light to import."""

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from objectfolder.errors import InputError
from pipeline.dataset.project_files import MATERIALS

FEWEST_FACES = 4

if TYPE_CHECKING:
    from objectfolder.making.materials import Material
    from objectfolder.making.mesh.walls import WallFinding


@dataclass(frozen=True)
class DescribedObject:
    """A mesh and what is known of the object; None where the files tell.

    Parameters
    ----------
    mesh
        OBJ, glTF, GLB, PLY, STL, OFF, 3MF, COLLADA, FBX, USD or .blend
    material
        a row of the materials table
    materials
        materials table (CSV)
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
    glass
        thin: light passes its walls, as through a slab each; opaque: none does
    mass_kg
        mass in kilograms where it is known: a check, and the mass for simulators
    up
        axis of the file that is up: x, y or z (default: y for glTF, z for all others)
    decimate
        at most this many faces: Blender collapses edges of a mesh that has more
    silent
        leave sound out: it is seen and felt
    """

    mesh: Path
    _: KW_ONLY
    material: str
    materials: Path = MATERIALS
    length_m: float | None = None
    object_id: str | None = None
    name: str | None = None
    texture: Path | None = None
    source: str = ""
    wall_m: float | None = None
    shell_m: float | None = None
    roughness: float | None = None
    metallic: float | None = None
    glass: Literal["opaque", "thin"] = "opaque"
    mass_kg: float | None = None
    up: str | None = None
    decimate: int | None = None
    silent: bool = False

    @property
    def senses(self) -> tuple[str, ...]:
        """Return the senses that it gets."""
        from pipeline.dataset.catalogue import SENSES

        return tuple(sense for sense in SENSES if not (self.silent and sense == "audio"))

    def check(self) -> None:
        """Raise `InputError` for an absent file, a number that cannot be, or two that exclude each other."""
        from objectfolder.making.mesh.up_axis import check_up_axis

        check_up_axis(self.up, "--up")
        for option, path in (("MESH", self.mesh), ("--texture", self.texture)):
            if path is not None and not path.is_file():
                raise InputError(f"{option} {path}", "no such file", "Correct the path")
        for option, value in (("--roughness", self.roughness), ("--metallic", self.metallic)):
            if value is not None and not 0 <= value <= 1:
                raise InputError(option, f"{value:g} is not in 0..1", "Correct it, or leave it out")
        if self.decimate is not None and self.decimate < FEWEST_FACES:
            finding = f"{self.decimate} faces bound no solid"
            raise InputError("--decimate", finding, f"Give {FEWEST_FACES} at least, such as 20000")
        lengths = (self.length_m, self.wall_m, self.shell_m, self.mass_kg)
        for option, value in zip(("--length", "--wall", "--shell", "--mass"), lengths, strict=True):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(option, f"{value:g} is not a positive number", "Correct it, or leave it out")
        if self.wall_m is not None and self.shell_m is not None:
            remedy = "State --wall for an open vessel with thin walls, --shell for one that is scanned solid"
            raise InputError("--shell", "is stated together with --wall", remedy)

    def findings(
        self, attributes: Mapping[str, Any], material: "Material"
    ) -> "tuple[list[str], tuple[WallFinding, ...]]":
        """Return the warnings of the object's product, and doubts about walls and mass in a material.

        What the product says of walls by geometry alone is left out of the warnings.
        """
        from objectfolder.making.mesh.walls import WallMeasures, wall_findings

        walls = WallMeasures(**attributes["walls"])
        by_geometry = set(map(str, wall_findings(walls)))
        warnings = [text for text in attributes["warnings"] if text not in by_geometry]
        return warnings, wall_findings(
            walls,
            material=material.name,
            density_kg_m3=material.density_kg_m3,
            mass_kg=self.mass_kg,
            wall_m=self.wall_m,
            shell_m=self.shell_m,
        )
