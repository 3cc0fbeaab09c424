"""Rows of tables and shapes of meshes, made by hand for the rules of a check."""

from pathlib import Path

from objectfolder.making.materials import read_materials
from objectfolder.making.mesh.walls import WallMeasures
from objectfolder.surface.connectivity import Topology
from pipeline.dataset.catalogue import ObjectRecord
from pipeline.intake.check.entry import Entry, Shape

REPOSITORY = Path(__file__).parents[2]
MATERIALS = read_materials(REPOSITORY / "data" / "materials.csv")


def shape(
    extents: tuple[float, float, float] = (0.1, 0.06, 0.04),
    *,
    file_extents: tuple[float, float, float] | None = None,
    volume: float | None = None,
    area: float | None = None,
    closed: bool = True,
    boundary_edges: int = 0,
    mesh: str = "mesh",
    texture: str | None = None,
    faces: int = 12,
) -> Shape:
    """A box of the given sides in metres, or what is said of it."""
    x, y, z = extents
    box, sides = x * y * z, 2 * (x * y + y * z + z * x)
    walls = WallMeasures(
        closed=closed,
        longest_m=max(extents),
        area_m2=sides if area is None else area,
        volume_m3=box if volume is None else volume,
        effective_m=2 * box / sides,
        median_m=min(extents),
        thin_m=min(extents),
        bulk_m=min(extents),
        wall_share=0.0,
        wall_median_m=None,
        wall_thin_m=None,
    )
    topology = Topology(
        watertight=closed,
        consistent=True,
        components=1,
        boundary_edges=boundary_edges,
        non_manifold_edges=0,
        zero_area_faces=0,
    )
    in_file = extents if file_extents is None else file_extents
    likeness = (walls.area_m2, walls.volume_m3, *sorted(in_file))
    return Shape(in_file, topology, walls, mesh, texture, faces, likeness)


def entry(
    object_id: str = "thing", material: str = "wood", *, of: Shape | None = None, **cells: str
) -> Entry:
    """A row with the given cells, read without a fault."""
    length = cells.get("length_m", "")
    record = ObjectRecord(
        id=object_id,
        name=cells.get("name", object_id),
        mesh=Path("model.obj"),
        texture=None,
        material=material,
        length_m=float(length) if length else None,
        source=cells.get("source", ""),
        licence=cells.get("licence", ""),
        attribution=cells.get("attribution", ""),
        wall_m=float(cells["wall_m"]) if "wall_m" in cells else None,
        shell_m=float(cells["shell_m"]) if "shell_m" in cells else None,
    )
    return Entry(object_id, {"id": object_id, "material": material, **cells}, MATERIALS, record, of)
