"""A mesh file of any supported kind to a textured mesh, uncleaned."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.geometry.mesh import TexturedMesh
from objectfolder.geometry.obj import read_obj
from objectfolder.geometry.scene_formats import FORMATS, read_scene
from objectfolder.geometry.textures import read_texture

MESH_SUFFIXES = (".obj", *FORMATS)


def load_mesh(path: Path, texture: Path | None = None, *, with_textures: bool = True) -> TexturedMesh:
    """Read OBJ, glTF, GLB, PLY or STL with its base colour textures.

    Objects are opaque to all senses: alpha is set to 255. Equal textures are kept once.

    Parameters
    ----------
    path
        The mesh; the suffix names the format.
    texture
        Replaces every texture and colour the mesh file names.
    with_textures
        False reads the shape alone, which is all that sound and touch need.

    Returns
    -------
    TexturedMesh
        Vertices and faces as in the file, in its own units and axes.

    Raises
    ------
    InputError
        Missing, unsupported, unreadable or empty file; coordinates that are not finite; a texture that is
        missing or has no texture coordinates to go with it.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(str(path), "the mesh file does not exist", "Correct the path or add the file")
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        known = ", ".join(MESH_SUFFIXES)
        raise InputError(
            str(path), f"{suffix or 'no suffix'!r} is not a known mesh format", f"Use one of {known}"
        )
    named_texture = read_texture(Path(texture)) if texture is not None and with_textures else None
    follow_materials = with_textures and named_texture is None
    reader = read_obj if suffix == ".obj" else read_scene
    mesh = reader(path, with_textures=follow_materials)
    _refuse_non_finite(path, mesh)
    if named_texture is not None:
        mesh = replace(
            mesh, textures=(named_texture,), face_texture=np.zeros(len(mesh.faces), dtype=np.int32)
        )
    return _with_coordinates(path, _with_distinct_textures(mesh))


def _refuse_non_finite(path: Path, mesh: TexturedMesh) -> None:
    bad = np.flatnonzero(~np.isfinite(mesh.vertices).all(axis=1))
    if len(bad):
        raise InputError(
            str(path),
            f"{len(bad)} of {len(mesh.vertices)} vertices are not finite (the first is vertex {bad[0] + 1})",
            "Repair the mesh: NaN and infinite coordinates have no place",
        )


def _with_distinct_textures(mesh: TexturedMesh) -> TexturedMesh:
    """Opaque textures, each kept once, in order of first use."""
    distinct: dict[tuple[tuple[int, ...], bytes], int] = {}
    kept: list[np.ndarray] = []
    index_of = np.zeros(len(mesh.textures), dtype=np.int32)
    for index, texture in enumerate(mesh.textures):
        opaque = texture.copy()
        opaque[..., 3] = 255
        key = (opaque.shape, opaque.tobytes())
        if key not in distinct:
            distinct[key] = len(kept)
            kept.append(opaque)
        index_of[index] = distinct[key]
    return replace(mesh, textures=tuple(kept), face_texture=index_of[mesh.face_texture])


def _with_coordinates(path: Path, mesh: TexturedMesh) -> TexturedMesh:
    """Texture coordinates without NaN: zero where the texture is one texel, refused where it is not."""
    missing = ~np.isfinite(mesh.texture_coordinates).all(axis=(1, 2))
    uniform = np.array([texture.shape[:2] == (1, 1) for texture in mesh.textures])
    bare = int(np.count_nonzero(missing & ~uniform[mesh.face_texture]))
    if bare:
        raise InputError(
            str(path),
            f"{bare} of {len(mesh.faces)} faces have a texture but no texture coordinates",
            "Unwrap the mesh, or leave the texture out to use its base colour",
        )
    coordinates = np.where(missing[:, None, None], 0.0, mesh.texture_coordinates)
    return replace(mesh, texture_coordinates=coordinates)
