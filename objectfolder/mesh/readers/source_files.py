"""Every file that a mesh is read from, for fingerprints."""

from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.mesh.readers.files import find_file, is_file
from objectfolder.mesh.readers.gltf_file import gltf_files
from objectfolder.mesh.readers.material_library import MOST_LIBRARIES, library_files, read_material_library
from objectfolder.mesh.readers.obj import material_libraries
from objectfolder.mesh.readers.ply import ply_texture_name


def source_files(mesh: Path, texture: Path | None = None) -> tuple[Path, ...]:
    """List the files whose bytes decide what `load_mesh(mesh, texture)` returns.

    The mesh and the named texture come first, present or not; then the present files that the mesh names.
    Material libraries and textures are left out where a named texture replaces them.
    """
    mesh = Path(mesh)
    named = [mesh] if texture is None else [mesh, Path(texture)]
    if not is_file(mesh):
        return tuple(named)
    suffix = mesh.suffix.lower()
    try:
        if suffix == ".obj":
            referred = [] if texture is not None else _obj_files(mesh)
        elif suffix in (".gltf", ".glb"):
            referred = gltf_files(mesh, with_images=texture is None)
        elif suffix == ".ply":
            referred = [] if texture is not None else _ply_files(mesh)
        else:
            referred = []
    except InputError:
        # Loading says what is wrong with them.
        referred = []
    return tuple(dict.fromkeys([*named, *(path for path in referred if path.is_file())]))


def _obj_files(mesh: Path) -> list[Path]:
    files: list[Path] = []
    for library in material_libraries(mesh)[:MOST_LIBRARIES]:
        files += library_files(mesh, library)
        materials = read_material_library(mesh, library).values()
        files += [file for material in materials for file in material.files]
    return files


def _ply_files(mesh: Path) -> list[Path]:
    name = ply_texture_name(mesh)
    found = None if name is None else find_file(mesh.parent, [name], within=mesh.parent)
    return [] if found is None else [found]
