"""A mesh file of any supported kind to a textured mesh, uncleaned; and the files that it is read from."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.blender import BLENDER_SUFFIXES, blender_files, read_with_blender
from objectfolder.making.mesh.readers.collada_file import collada_files, read_collada
from objectfolder.making.mesh.readers.face_count import refuse_many_faces
from objectfolder.making.mesh.readers.files import find_file, is_file, usual_places
from objectfolder.making.mesh.readers.gltf import read_gltf
from objectfolder.making.mesh.readers.gltf_file import gltf_files
from objectfolder.making.mesh.readers.material_library import (
    MOST_LIBRARIES,
    library_files,
    read_material_library,
)
from objectfolder.making.mesh.readers.obj import material_libraries, read_obj
from objectfolder.making.mesh.readers.off import read_off
from objectfolder.making.mesh.readers.ply import ply_texture_name, read_ply
from objectfolder.making.mesh.readers.stl import read_stl
from objectfolder.making.mesh.readers.textures import opaque, read_texture
from objectfolder.making.mesh.readers.three_mf import read_three_mf
from objectfolder.making.mesh.up_axis import check_up_axis, up_axis, z_up
from objectfolder.products.regular_file import open_regular
from objectfolder.surface.textured_mesh import TexturedMesh

Value = TypeVar("Value")

_READERS = {
    ".obj": read_obj,
    ".gltf": read_gltf,
    ".glb": read_gltf,
    ".ply": read_ply,
    ".stl": read_stl,
    ".off": read_off,
    ".3mf": read_three_mf,
    ".dae": read_collada,
    **dict.fromkeys(BLENDER_SUFFIXES, read_with_blender),
}

MESH_SUFFIXES = tuple(_READERS)

_HEAD_BYTES = 512

_MAGIC = (
    (b"version https://git-lfs", "a pointer of Git LFS, not the file itself", "Fetch it: git lfs pull"),
    (b"\x1f\x8b", "compressed by gzip", "Unpack it: gunzip"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", "Unpack it, and name the mesh in it"),
    (b"Rar!", "a rar archive", "Unpack it, and name the mesh in it"),
    (b"%PDF", "a PDF", "Name a mesh"),
    (b"\x89PNG", "a PNG image", "Name a mesh"),
    (b"\xff\xd8\xff", "a JPEG image", "Name a mesh"),
)
"""First bytes, what a file is that has them, and what to do."""

_FORMATS = (
    (b"PK\x03\x04", "a zip archive", (".3mf", ".usdz")),
    (b"BLENDER", "a file of Blender", (".blend",)),
    (b"Kaydara FBX", "an FBX file", (".fbx",)),
    (b"PXR-USDC", "a USD file", (".usdc", ".usd")),
    (b"#usda", "a USD file", (".usda", ".usd")),
    (b"glTF", "a binary glTF", (".glb",)),
    (b"ply\n", "a PLY file", (".ply",)),
    (b"ply\r", "a PLY file", (".ply",)),
    (b"OFF", "an OFF file", (".off",)),
)
"""First bytes of formats that are read, and the endings of their names."""


def load_mesh(
    path: Path,
    texture: Path | None = None,
    *,
    with_textures: bool = True,
    up: str | None = None,
    any_count: bool = False,
) -> TexturedMesh:
    """Read a mesh of any format of `MESH_SUFFIXES` with its textures, and maps of reflectance and normals.

    FBX, USD and .blend files are read by Blender, in a child process.

    Alpha is 255 but where the source asks for transparency: by glTF's `alphaMode`, or by `d` or `map_d` of a
    material library. Equal textures with equal maps are kept once.

    Parameters
    ----------
    path
        The mesh; the suffix names the format.
    texture
        Replaces every texture, map and colour the mesh file names. Its alpha is ignored.
    with_textures
        False reads the shape alone, which is all that sound and touch need.
    up
        Axis of the file that is up, ``"x"``, ``"y"`` or ``"z"``; None takes y for glTF, what a
        COLLADA file says, and z for all others.
    any_count
        Read also a file with more faces than an Object File can hold.

    Returns
    -------
    TexturedMesh
        Vertices and faces as in the file, in metres where its format has units, turned so that z is up.

    Raises
    ------
    InputError
        Missing, unsupported, unreadable or empty file; coordinates that are not finite; a texture that is
        missing or has no texture coordinates to go with it.

    Examples
    --------
    >>> from pathlib import Path
    >>> mesh = load_mesh(Path("bar.obj"))
    >>> round(float(mesh.surface.area), 4)  # square metres: 2 (0.12 0.03 + 0.12 0.008 + 0.03 0.008)
    0.0096
    """
    path = Path(path)
    check_up_axis(up, str(path))
    if not is_file(path):
        raise InputError(str(path), "the mesh file does not exist", "Correct the path or add the file")
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        formats = ", ".join(MESH_SUFFIXES)
        finding = f"{suffix or 'no suffix'!r} is not a known mesh format"
        raise InputError(str(path), finding, f"Use one of {formats}")
    _refuse_foreign(path)
    if not any_count:
        refuse_many_faces(path)
    named_texture = read_texture(Path(texture)) if texture is not None and with_textures else None
    follow_materials = with_textures and named_texture is None
    try:
        mesh = _READERS[suffix](path, with_textures=follow_materials)
    except MemoryError as problem:
        raise InputError(
            str(path), "does not fit the memory", "Reduce its number of triangles or texels"
        ) from problem
    if named_texture is not None:
        mesh = replace(
            mesh,
            textures=(opaque(named_texture),),
            face_texture=np.zeros(len(mesh.faces), dtype=np.int32),
            alpha_cutoffs={},
            roughness_maps={},
            metallic_maps={},
            normal_maps={},
        )
    return z_up(_with_coordinates(path, _with_distinct_textures(mesh)), up or up_axis(path))


def _with_distinct_textures(mesh: TexturedMesh) -> TexturedMesh:
    """Textures with what goes with them, each kept once, in order of first use."""
    distinct: dict[tuple[Any, ...], int] = {}
    indices: list[int] = []
    index_of = np.zeros(len(mesh.textures), dtype=np.int32)
    for index, texture in enumerate(mesh.textures):
        maps = [of.get(index) for of in (mesh.roughness_maps, mesh.metallic_maps, mesh.normal_maps)]
        key = (_content(texture), *map(_content, maps), mesh.alpha_cutoffs.get(index))
        if key not in distinct:
            distinct[key] = len(indices)
            indices.append(index)
        index_of[index] = distinct[key]

    def renumbered(by_texture: Mapping[int, Value]) -> dict[int, Value]:
        return {new: by_texture[old] for new, old in enumerate(indices) if old in by_texture}

    return replace(
        mesh,
        textures=tuple(mesh.textures[index] for index in indices),
        face_texture=index_of[mesh.face_texture],
        alpha_cutoffs=renumbered(mesh.alpha_cutoffs),
        roughness_maps=renumbered(mesh.roughness_maps),
        metallic_maps=renumbered(mesh.metallic_maps),
        normal_maps=renumbered(mesh.normal_maps),
    )


def _content(image: np.ndarray | None) -> bytes | None:
    return None if image is None else hashlib.sha256(f"{image.shape}".encode() + image.tobytes()).digest()


def _with_coordinates(path: Path, mesh: TexturedMesh) -> TexturedMesh:
    """Texture coordinates without NaN: zero where the texture is one texel, refused where it is not."""
    missing = ~np.isfinite(mesh.texture_coordinates).all(axis=(1, 2))
    uniform = np.array([texture.shape[:2] == (1, 1) for texture in mesh.textures])
    for image_of in (mesh.roughness_maps, mesh.metallic_maps, mesh.normal_maps):
        for index, image in image_of.items():
            uniform[index] &= image.shape[:2] == (1, 1)
    bare = int(np.count_nonzero(missing & ~uniform[mesh.face_texture]))
    if bare:
        raise InputError(
            str(path),
            f"{bare} of {len(mesh.faces)} faces have a texture but no texture coordinates",
            "Unwrap the mesh, or leave the texture out to use its base colour",
        )
    coordinates = np.where(missing[:, None, None], 0.0, mesh.texture_coordinates)
    return replace(mesh, texture_coordinates=coordinates)


def source_files(mesh: Path, texture: Path | None = None) -> tuple[Path, ...]:
    """List the files whose bytes decide what `load_mesh(mesh, texture)` returns.

    The mesh and the named texture come first, present or not; then the present files that the mesh names.
    Material libraries and textures are left out where a named texture replaces them.
    """
    mesh = Path(mesh)
    files = [mesh] if texture is None else [mesh, Path(texture)]
    if not is_file(mesh):
        return tuple(files)
    suffix = mesh.suffix.lower()
    try:
        if suffix in (".gltf", ".glb"):
            referred = gltf_files(mesh, with_images=texture is None)
        elif suffix in _FILES_OF:
            referred = [] if texture is not None else _FILES_OF[suffix](mesh)
        else:
            referred = []
    except InputError:
        # Loading says what is wrong with them.
        referred = []
    return tuple(dict.fromkeys([*files, *(path for path in referred if path.is_file())]))


def _obj_files(mesh: Path) -> list[Path]:
    files: list[Path] = []
    for library in material_libraries(mesh)[:MOST_LIBRARIES]:
        files += library_files(mesh, library)
        materials = read_material_library(mesh, library).values()
        files += [file for material in materials for file in material.files]
    return files


def _ply_files(mesh: Path) -> list[Path]:
    name = ply_texture_name(mesh)
    picture = None if name is None else find_file(mesh.parent, usual_places(name), within=mesh.parent)
    return [] if picture is None else [picture]


_FILES_OF = {
    ".obj": _obj_files,
    ".ply": _ply_files,
    ".dae": collada_files,
    **dict.fromkeys(BLENDER_SUFFIXES, blender_files),
}


def _refuse_foreign(path: Path) -> None:
    """Raise `InputError` for what is another kind of file than its name says, with the remedy.

    Raises
    ------
    InputError
        An empty file, a pointer, a web page, an archive, a picture, or a mesh of another format.
    """
    try:
        with open_regular(path) as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return  # reading says why
    if not head:
        raise InputError(str(path), "is empty: it holds no faces", "Copy or download it again")
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    if text.startswith((b"<!doctype html", b"<html", b"<head")):
        raise InputError(
            str(path), "cannot be read: it is a web page", "Download the file by its raw address"
        )
    suffix = path.suffix.lower()
    for start, kind, remedy in _MAGIC:
        if head.startswith(start):
            raise InputError(str(path), f"cannot be read: it is {kind}", remedy)
    for start, kind, suffixes in _FORMATS:
        if head.startswith(start) and suffix not in suffixes and not _is_word(head, start):
            remedy = f"Let its name end in {suffixes[0]}"
            if kind == "a zip archive":
                remedy = "Unpack it, and name the mesh in it"
            raise InputError(str(path), f"cannot be read: it is {kind}", remedy)
    if text.startswith(b"{") and b'"asset"' in text and suffix == ".glb":
        raise InputError(str(path), "cannot be read: it is a glTF as text", "Let its name end in .gltf")
    if b"<collada" in text and suffix != ".dae":
        raise InputError(str(path), "cannot be read: it is a COLLADA file", "Let its name end in .dae")


def _is_word(head: bytes, start: bytes) -> bool:
    """Whether the start of an OBJ or STL as text only looks like the magic of OFF."""
    return start == b"OFF" and head[3:4] not in b"\r\n "
