"""Measurements of a check on the mesh of an object."""

from dataclasses import dataclass

from objectfolder.catalogue import ObjectRecord
from objectfolder.mesh.cleaning import clean
from objectfolder.mesh.length import with_length
from objectfolder.mesh.readers.load import load_mesh
from objectfolder.mesh.solid_properties import Topology, solid_properties, topology_of
from objectfolder.mesh.walls.measures import WallMeasures, measure_walls
from objectfolder.products.provenance import file_digest


@dataclass(frozen=True)
class Shape:
    """An object as it would be made, and the file that it is made from.

    Parameters
    ----------
    file_extents
        Sides of the bounding box as in the file, in its own unit.
    topology, walls
        Of the cleaned surface at its stated size.
    mesh_sha256, texture_sha256
        Of the bytes of the files; None without a texture of its own.
    faces
        Of the cleaned surface.
    likeness
        Numbers that a copy shares wherever it was moved and in whatever order it was written: area, volume
        and sides of the bounding box in order of length, in the file's own unit.
    """

    file_extents: tuple[float, float, float]
    topology: Topology
    walls: WallMeasures
    mesh_sha256: str
    texture_sha256: str | None
    faces: int
    likeness: tuple[float, ...]

    @property
    def file_length(self) -> float:
        """Longest side as in the file."""
        return max(self.file_extents)

    @property
    def length_m(self) -> float:
        """Longest side as it would be made."""
        return self.walls.longest_m


def measure(record: ObjectRecord) -> Shape:
    """Read and clean the mesh of a row as the factory does, and measure it: about a second.

    Raises
    ------
    InputError
        Files that the factory cannot use.
    """
    where = f"{record.id} ({record.mesh.name})"
    cleaned, _ = clean(load_mesh(record.mesh, record.texture), where)
    extents = tuple(float(side) for side in cleaned.extents)
    mesh, _ = with_length(cleaned, record.length_m, where)
    return Shape(
        file_extents=(extents[0], extents[1], extents[2]),
        topology=topology_of(mesh.vertices, mesh.faces),
        walls=measure_walls(mesh.surface),
        mesh_sha256=file_digest(record.mesh),
        texture_sha256=None if record.texture is None else file_digest(record.texture),
        faces=len(cleaned.faces),
        likeness=(
            cleaned.surface.area,
            abs(solid_properties(cleaned.vertices, cleaned.faces).volume_m3),
            *sorted(extents),
        ),
    )
