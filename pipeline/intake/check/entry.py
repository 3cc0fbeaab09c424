"""A row of a table of objects as the rules of a check see it, and what they find."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from objectfolder.errors import InputError
from objectfolder.making.materials import Material
from objectfolder.making.mesh.cleaning import CleaningReport, clean
from objectfolder.making.mesh.readers.load import load_mesh
from objectfolder.making.mesh.walls import WallMeasures, measure_walls
from objectfolder.products.provenance import file_digest
from objectfolder.surface.connectivity import Topology
from objectfolder.surface.integrals import solid_properties
from objectfolder.surface.textured_mesh import with_length
from pipeline.dataset.catalogue import ObjectRecord, number_in
from pipeline.intake.sources.registry import SOURCES, source_and_name
from pipeline.intake.sources.source import Source
from pipeline.run.looks import looks_of

ERROR, WARNING, NOTE = SEVERITIES = ("error", "warning", "note")

NAMES = {
    "ycb": ("ycb",),
    "gso": ("google scanned", "gso", "scanned objects by google"),
    "polyhaven": ("poly haven", "polyhaven", "3d model haven", "3dmodelhaven"),
}
"""By the id of a source, texts that name it in the column `source`, in small letters."""


@dataclass(frozen=True)
class Shape:
    """An object as it would be made, and the file that it is made from.

    Attributes
    ----------
    file_extents : sides of the bounding box as in the file, in its own unit
    topology, walls : of the cleaned surface at its stated size
    cleaning : what cleaning found; None where it was not asked
    mesh_sha256, texture_sha256 : of the bytes of the files; None without a texture of its own
    faces : of the cleaned surface
    likeness : numbers that a copy shares wherever it was moved and in whatever order it was written: area,
        volume and sides of the bounding box in order of length, in the file's own unit
    remarks : what was read otherwise than the file says it
    looks : textures, colours and maps in a line
    """

    file_extents: tuple[float, float, float]
    topology: Topology
    walls: WallMeasures
    mesh_sha256: str
    texture_sha256: str | None
    faces: int
    likeness: tuple[float, ...]
    cleaning: CleaningReport | None = None
    remarks: tuple[str, ...] = ()
    looks: str = ""

    @property
    def file_length(self) -> float:
        """Longest side as in the file."""
        return max(self.file_extents)

    @property
    def length_m(self) -> float:
        """Longest side as it would be made."""
        return self.walls.longest_m


@dataclass(frozen=True)
class Finding:
    """A finding, and its remedy.

    Attributes
    ----------
    severity : ``"error"``: wrong, or cannot be built; ``"warning"``: doubtful; ``"note"``: good to know
    object_id : whose row it is
    field : column that it is about
    rule : what found it: the name that the column `accepted` may list
    found : a phrase with numbers and units
    remedy : what to do
    accepted : whether the row says that this was looked at and stays
    """

    severity: str
    object_id: str
    field: str
    rule: str
    found: str
    remedy: str
    accepted: bool = False


@dataclass(frozen=True)
class Entry:
    """A row, and what is known of its mesh.

    Attributes
    ----------
    object_id : the row's id; ``line N`` where it has none
    cells : text of every column, known to the factory or not
    materials : the table of materials
    record : the row as the factory reads it; None for a row with a fault
    shape : what was measured on the mesh; None where it could not be, or was not asked for
    problem : why there is no record, or no shape
    """

    object_id: str
    cells: Mapping[str, str] = field(default_factory=dict)
    materials: Mapping[str, Material] = field(default_factory=dict)
    record: ObjectRecord | None = None
    shape: Shape | None = None
    problem: InputError | None = None

    def cell(self, column: str) -> str:
        """Return a cell; empty where the table has no such column."""
        return self.cells.get(column, "")

    def number(self, column: str) -> float | None:
        """Return a positive number; None for an empty cell or anything else (see the rule `readable`)."""
        value = number_in(self.cell(column))
        return value if math.isfinite(value) and value > 0 else None

    @property
    def material(self) -> Material | None:
        """Its material; None where the table of materials does not have it."""
        return self.materials.get(self.cell("material"))

    @property
    def names(self) -> str:
        """Id and name."""
        return f"{self.object_id} {self.cell('name')}"

    @property
    def source(self) -> Source | None:
        """The public source that it names, by its source_id or in words; None for one's own."""
        if ":" not in self.cell("source_id"):
            return self.source_in_words
        try:
            return source_and_name(self.cell("source_id"))[0]
        except InputError:
            return None  # a finding of its own: `row_rules.check_provenance`

    @property
    def source_in_words(self) -> Source | None:
        """The public source that the column `source` names."""
        text = self.cell("source").lower()
        return next(
            (SOURCES[source_id] for source_id, names in NAMES.items() if any(name in text for name in names)),
            None,
        )

    @property
    def is_unfetched(self) -> bool:
        """Whether all that is wrong is that the object's files are not fetched yet."""
        return self.problem is not None and self.problem.remedy.startswith("objectfolder fetch ")

    def finding(self, rule: str, severity: str, column: str, finding: str, remedy: str) -> Finding:
        """Return a finding of this row."""
        return Finding(severity, self.object_id, column, rule, finding, remedy)


def measure(record: ObjectRecord) -> Shape:
    """Read and clean the mesh of a row as the factory does, and measure it: about a second.

    Raises
    ------
    InputError
        Files that the factory cannot use.
    """
    where = f"{record.id} ({record.mesh.name})"
    clean_mesh, report = clean(load_mesh(record.mesh, record.texture, up=record.up), where)
    extents = tuple(float(side) for side in clean_mesh.extents)
    mesh, _ = with_length(clean_mesh, record.length_m, where)
    return Shape(
        file_extents=(extents[0], extents[1], extents[2]),
        topology=mesh.surface.topology,
        walls=measure_walls(mesh.surface),
        mesh_sha256=file_digest(record.mesh),
        texture_sha256=None if record.texture is None else file_digest(record.texture),
        faces=len(clean_mesh.faces),
        cleaning=report,
        remarks=mesh.remarks,
        looks=looks_of(mesh),
        likeness=(
            clean_mesh.surface.area,
            abs(solid_properties(clean_mesh.vertices, clean_mesh.faces).volume_m3),
            *sorted(extents),
        ),
    )
