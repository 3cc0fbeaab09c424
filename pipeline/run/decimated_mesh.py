"""A decimated mesh in place of one that has too many faces, as a file that holds all that it looks like."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from pipeline.dataset.described_object import DescribedObject

if TYPE_CHECKING:
    from objectfolder.making.materials import Material

Described = TypeVar("Described", bound=DescribedObject)


def with_decimated_mesh(
    item: Described, material: "Material", folder: Path
) -> tuple[Described, tuple[str, ...]]:
    """Return the object with a mesh of at most `decimate` faces, written to a folder, and what to say of it.

    The file is a GLB with the pictures and maps of the source in it. An object whose mesh has no more faces
    is returned as it is.

    Raises
    ------
    InputError
        A mesh that cannot be read.
    MissingPackageError, SimulationError
        Blender is not installed, or cannot reach so few faces.
    """
    from objectfolder.export.files import Credit
    from objectfolder.export.textured_surface import write_mesh
    from objectfolder.making.mesh.readers.load import load_mesh
    from objectfolder.vision.appearance import Appearance
    from pipeline.run.decimation import decimate

    faces = item.decimate or 0
    mesh = load_mesh(item.mesh, item.texture, up=item.up, any_count=True)
    result = decimate(mesh, faces)
    if result.mesh is mesh:
        remark = f"its {len(mesh.faces)} faces are no more than {faces}: it is not decimated"
        return replace(item, decimate=None), (remark,)
    appearance = Appearance(
        material.roughness if item.roughness is None else item.roughness,
        material.metallic if item.metallic is None else item.metallic,
    )
    path = folder / f"{item.mesh.stem}.glb"
    folder.mkdir(parents=True, exist_ok=True)
    write_mesh(path, result.mesh, appearance, Credit(item.object_id or item.mesh.stem))
    length_m = item.length_m or float(mesh.extents.max())
    remark = (
        f"decimated from {result.faces_before} to {len(result.mesh.faces)} faces: the surfaces lie within "
        f"{1e3 * result.distance_share * length_m:.2g} mm of one another, {result.distance_share:.1e} of the "
        "length"
    )
    return replace(item, mesh=path, texture=None, up=None, decimate=None), (remark, *mesh.remarks)
