"""Wavefront OBJ with its material library.

Read here and not with trimesh, which splits or merges vertices to give each one texture coordinate, resolves
negative indices from the end of the file, and passes over a missing texture in silence.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.geometry.material_library import ObjMaterial, ScalarMap, read_material_library
from objectfolder.geometry.mesh import TexturedMesh
from objectfolder.geometry.textures import (
    corner_colour_atlas,
    opaque,
    read_texture,
    scaled_map,
    uniform_map,
    uniform_texture,
    with_alpha,
)


@dataclass
class _Statements:
    """What the lines of an OBJ file say, polygons already fanned into triangles."""

    vertices: list[list[float]] = field(default_factory=list)
    texture_vertices: list[list[float]] = field(default_factory=list)
    faces: list[list[int]] = field(default_factory=list)
    face_texture_vertices: list[list[int]] = field(default_factory=list)
    face_materials: list[str] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)


def read_obj(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read an OBJ file as it is, uncleaned; corners without texture coordinates get NaN.

    Polygons are fanned from their first corner. `Kd` is taken as sRGB-encoded and only where there is no
    `map_Kd`; objects and groups are joined. A surface is transparent only where the material library says so
    by `d` below 1 or `map_d`.

    Parameters
    ----------
    with_textures
        False leaves material library and textures unread (they may then be missing).

    Raises
    ------
    InputError
        A line that cannot be read (with its number), an index out of range, no faces, a missing material
        library or texture.
    """
    statements = _parse(path)
    if not statements.faces:
        raise InputError(str(path), "holds no faces", "Use a Wavefront OBJ file with `v` and `f` lines")
    columns = min(len(row) for row in statements.vertices)
    numbers = np.array([row[:columns] for row in statements.vertices], dtype=np.float64)
    vertices, faces = numbers[:, :3].copy(), np.array(statements.faces, dtype=np.int64)
    coordinates = _corner_coordinates(statements)
    if with_textures:
        materials, face_texture = _materials(path, statements)
    else:
        materials, face_texture = [ObjMaterial()], np.zeros(len(faces), dtype=np.int32)
    textures = tuple(_texture(material) for material in materials)
    if with_textures and columns >= 6 and all(len(texture) == 1 for texture in textures):
        colours = np.concatenate([numbers[:, 3:6][faces], np.ones((len(faces), 3, 1))], axis=2)
        atlas, coordinates = corner_colour_atlas(colours)
        materials, textures, face_texture = [], (opaque(atlas),), np.zeros(len(faces), dtype=np.int32)
    roughness = [_scalar(material.roughness_map, material.roughness) for material in materials]
    metallic = [_scalar(material.metallic_map, material.metallic) for material in materials]
    return TexturedMesh(
        vertices,
        faces,
        coordinates,
        textures,
        face_texture,
        roughness_maps={index: image for index, image in enumerate(roughness) if image is not None},
        metallic_maps={index: image for index, image in enumerate(metallic) if image is not None},
    )


def _corner_coordinates(statements: _Statements) -> np.ndarray:
    if not statements.texture_vertices:
        return np.full((len(statements.faces), 3, 2), np.nan)
    pairs = [[*row, 0.0][:2] for row in statements.texture_vertices]
    table = np.array([*pairs, [np.nan, np.nan]], dtype=np.float64)
    return table[np.array(statements.face_texture_vertices, dtype=np.int64)]


def _parse(path: Path) -> _Statements:
    statements = _Statements()
    material = ""
    text = path.read_text(encoding="utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), start=1):
        keyword, *values = line.split("#", 1)[0].split() or [""]
        try:
            if keyword == "v":
                statements.vertices.append(_floats(values, 3))
            elif keyword == "vt":
                statements.texture_vertices.append(_floats(values, 1))
            elif keyword == "f":
                _append_polygon(statements, values, material)
            elif keyword == "usemtl":
                material = " ".join(values)
            elif keyword == "mtllib":
                statements.libraries.append(line.split(maxsplit=1)[1].strip())
        except (ValueError, IndexError) as problem:
            raise InputError(
                f"{path} line {number}",
                f"cannot be read as Wavefront OBJ ({problem}): {line[:60]!r}",
                "Export the mesh again",
            ) from problem
    return statements


def _floats(values: list[str], least: int) -> list[float]:
    if len(values) < least:
        raise ValueError(f"{len(values)} numbers where {least} are needed")
    return [float(value) for value in values]


def _append_polygon(statements: _Statements, corners: list[str], material: str) -> None:
    if len(corners) < 3:
        raise ValueError("a face needs three corners")
    vertex_indices, texture_indices = [], []
    for corner in corners:
        parts = corner.split("/")
        vertex_indices.append(_resolved(int(parts[0]), len(statements.vertices), "vertex"))
        texture = parts[1] if len(parts) > 1 else ""
        # -1 is the row of NaN that the table of texture coordinates ends with.
        count = len(statements.texture_vertices)
        texture_indices.append(_resolved(int(texture), count, "texture coordinate") if texture else -1)
    for second in range(1, len(corners) - 1):
        statements.faces.append([vertex_indices[i] for i in (0, second, second + 1)])
        statements.face_texture_vertices.append([texture_indices[i] for i in (0, second, second + 1)])
        statements.face_materials.append(material)


def _resolved(index: int, count: int, kind: str) -> int:
    """Zero-based index: positive ones count from 1, negative ones back from the last defined so far."""
    resolved = index - 1 if index > 0 else count + index
    if index == 0 or not 0 <= resolved < count:
        raise ValueError(f"{kind} {index} of {count} defined so far")
    return resolved


def _materials(path: Path, statements: _Statements) -> tuple[list[ObjMaterial], np.ndarray]:
    """Materials in order of first use, and the index of each face's."""
    known: dict[str, ObjMaterial] = {}
    for library in statements.libraries:
        known |= read_material_library(path, library)
    names = list(dict.fromkeys(statements.face_materials))
    index_of = {name: index for index, name in enumerate(names)}
    return (
        [known.get(name, ObjMaterial()) for name in names],
        np.array([index_of[name] for name in statements.face_materials], dtype=np.int32),
    )


def _texture(material: ObjMaterial) -> np.ndarray:
    """Base colour RGBA, opaque but where the material asks for transparency."""
    if material.texture is not None:
        texture = opaque(read_texture(material.texture))
    else:
        texture = uniform_texture(material.colour)
    factor = 1.0 if material.opacity is None else material.opacity
    if material.opacity_map is not None:
        return with_alpha(texture, scaled_map(_levels(material.opacity_map, of_opacity=True), factor))
    return texture if factor == 1.0 else with_alpha(texture, uniform_map(factor))


def _scalar(image: ScalarMap | None, value: float | None) -> np.ndarray | None:
    if image is not None:
        return _levels(image, of_opacity=False)
    return None if value is None else uniform_map(value)


def _levels(image: ScalarMap, *, of_opacity: bool) -> np.ndarray:
    """(h, w) uint8 of the channel that holds the quantity."""
    rgba = read_texture(image.file)
    if image.channel is not None:
        return np.ascontiguousarray(rgba[..., image.channel])
    in_alpha = of_opacity and bool((rgba[..., 3] < 255).any())
    return np.ascontiguousarray(rgba[..., 3 if in_alpha else 0])
