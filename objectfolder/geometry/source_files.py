"""Every file that a mesh is read from, for fingerprints."""

from pathlib import Path
from urllib.parse import unquote

from objectfolder.errors import InputError
from objectfolder.geometry.material_library import library_files, read_material_library
from objectfolder.geometry.scene_formats import gltf_header, ply_texture_name


def source_files(mesh: Path, texture: Path | None = None) -> tuple[Path, ...]:
    """List the files whose bytes decide what `load_mesh(mesh, texture)` returns.

    The mesh and the named texture come first, there or not; then what the mesh refers to and what is there.
    Material libraries and textures are left out where a named texture replaces them.
    """
    mesh = Path(mesh)
    named = [mesh] if texture is None else [mesh, Path(texture)]
    if not mesh.is_file():
        return tuple(named)
    suffix = mesh.suffix.lower()
    try:
        if suffix == ".obj":
            referred = [] if texture is not None else _obj_files(mesh)
        elif suffix in (".gltf", ".glb"):
            referred = _gltf_files(mesh, with_images=texture is None)
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
    with mesh.open(encoding="utf-8", errors="replace") as lines:
        libraries = [line.split(maxsplit=1)[1].strip() for line in lines if line.startswith("mtllib ")]
    for library in libraries:
        files += library_files(mesh, library)
        materials = read_material_library(mesh, library).values()
        files += [file for material in materials for file in material.files]
    return files


def _gltf_files(mesh: Path, *, with_images: bool) -> list[Path]:
    header = gltf_header(mesh)
    entries = header.get("buffers", []) + (header.get("images", []) if with_images else [])
    names = [entry["uri"] for entry in entries if "uri" in entry]
    return [mesh.parent / unquote(name) for name in names if not name.startswith("data:")]


def _ply_files(mesh: Path) -> list[Path]:
    name = ply_texture_name(mesh)
    return [] if name is None else [mesh.parent / name]
