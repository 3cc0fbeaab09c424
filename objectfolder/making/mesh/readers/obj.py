"""Wavefront OBJ with its material library.

Read here and not with trimesh, which splits or merges vertices to give each one texture coordinate, resolves
negative indices from the end of the file, and passes over a missing texture in silence.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import (
    brief,
    joined_lines,
    read_text,
    refuse_unusable,
    shortened,
    unquoted,
    without_comment,
)
from objectfolder.making.mesh.readers.material_library import (
    MOST_LIBRARIES,
    ObjMaterial,
    ScalarMap,
    read_material_library,
)
from objectfolder.making.mesh.readers.polygons import triangulated
from objectfolder.making.mesh.readers.textures import (
    TextureReader,
    corner_colour_atlas,
    holds_normals,
    opaque,
    scaled_map,
    scaled_normals,
    uniform_map,
    uniform_texture,
    with_alpha,
)
from objectfolder.making.mesh.readers.vertex_colours import all_white, colour_rows, vertex_colours_of
from objectfolder.surface.textured_mesh import TexturedMesh

_NAMELESS = ("", "none", "null", "(null)", "nil", "default")
"""What exporters write in `usemtl` for no material."""

_LEFT_OUT = {"surf": "its free-form surfaces", "call": "the files that it calls"}


@dataclass
class _Statements:
    """What the lines of an OBJ file say; a polygon before the first `usemtl` has the material None.

    Indices are those of rows, from 0 on, or -1 for none; `lines` has where each polygon stands.
    """

    vertices: list[list[float]] = field(default_factory=list)
    texture_vertices: list[list[float]] = field(default_factory=list)
    normals: list[list[float]] = field(default_factory=list)
    polygons: list[list[int]] = field(default_factory=list)
    polygon_texture_vertices: list[list[int]] = field(default_factory=list)
    polygon_normals: list[list[int]] = field(default_factory=list)
    polygon_materials: list[str | None] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)
    left_out: dict[str, None] = field(default_factory=dict)


@dataclass(frozen=True)
class _Triangles:
    """Vertex, texture vertex and normal of corners, (F, 3) each, and the polygon of each triangle, (F,)."""

    faces: np.ndarray
    texture_vertices: np.ndarray
    normals: np.ndarray
    polygon: np.ndarray


def read_obj(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read an OBJ file as it is, uncleaned; corners without texture coordinates get NaN.

    Polygons are cut into triangles (see `polygons.triangulated`). `Kd` is taken as sRGB-encoded and only
    where there is no `map_Kd`; objects and groups are joined. A surface is transparent only where the
    material library says so by `d` below 1 or `map_d`. Colours of vertices are sRGB-encoded too, in 0..1 or
    0..255. What readers of OBJ take is taken: faces before vertices, indices of tables that are not there,
    a 0 for no index, all indices from 0 on where a file has a vertex 0, and the only material of its library
    where it names none.

    Parameters
    ----------
    with_textures
        False leaves material library and textures unread (they may then be missing).

    Raises
    ------
    InputError
        A line that cannot be read (with its number), an index out of range, no faces, a missing material
        library or texture, a material that no library of the mesh defines.
    """
    statements = _parse(path)
    if not statements.polygons:
        raise InputError(str(path), "holds no faces", "Use a Wavefront OBJ file with `v` and `f` lines")
    vertices = np.array([row[:3] for row in statements.vertices], dtype=np.float64)
    refuse_unusable(path, vertices)
    triangles = _triangles(path, vertices, statements)
    faces, coordinates = triangles.faces, _corner_coordinates(statements, triangles)
    remarks = list(statements.left_out)
    if with_textures:
        materials, of_polygon = _materials(path, statements, remarks)
        face_texture = of_polygon[triangles.polygon]
        remarks += _without_colour(statements)
    else:
        materials, face_texture = [ObjMaterial()], np.zeros(len(faces), dtype=np.int32)
    remarks += [remark for material in materials for remark in material.remarks]
    reader = TextureReader(str(path))
    textures = tuple(reader.count(_colour_image(material, reader)) for material in materials)
    rows = colour_rows(statements.vertices, remarks)
    plain = all(texture.shape[:2] == (1, 1) for texture in textures)
    has_materials = statements.libraries and any(material.has_colour for material in materials)
    if with_textures and any(rows) and (has_materials or not plain) and not all_white(rows):
        remarks.append(
            "the colours of its vertices are taken, and not those of its materials"
            if plain
            else "the colours of its vertices are not used: it has a picture"
        )
    if with_textures and any(rows) and plain and not (has_materials and all_white(rows)):
        colours = vertex_colours_of(path, rows, remarks)[faces]
        atlas, coordinates = corner_colour_atlas(
            np.concatenate([colours, np.ones((len(faces), 3, 1))], axis=2)
        )
        materials, textures, face_texture = [], (opaque(atlas),), np.zeros(len(faces), dtype=np.int32)
    roughness = [_scalar_image(material.roughness_map, material.roughness, reader) for material in materials]
    normals = [_normal_image(material, reader) for material in materials]
    metallic = [_scalar_image(material.metallic_map, material.metallic, reader) for material in materials]
    return TexturedMesh(
        vertices,
        faces,
        coordinates,
        textures,
        face_texture,
        _corner_normals(statements, triangles),
        roughness_maps={index: image for index, image in enumerate(roughness) if image is not None},
        metallic_maps={index: image for index, image in enumerate(metallic) if image is not None},
        normal_maps={index: image for index, image in enumerate(normals) if image is not None},
        remarks=tuple(dict.fromkeys(remarks)),
    )


def material_libraries(path: Path) -> list[str]:
    """Return what the `mtllib` statements of an OBJ file name, as written."""
    libraries = []
    text = read_text(path)
    for line in joined_lines(text) if "\\" in text else _lines_with("mtllib", text):
        words = line.split(maxsplit=1)
        if words[:1] == ["mtllib"] and len(words) == 2:
            libraries.append(words[1].strip())
    return list(dict.fromkeys(libraries))


def _lines_with(word: str, text: str) -> Iterator[str]:
    """Yield the lines that have a word; every run looks for it in all meshes, so others are not split."""
    end = 0
    while (place := text.find(word, end)) >= 0:
        end = text.find("\n", place)
        end = len(text) if end < 0 else end
        yield text[text.rfind("\n", 0, place) + 1 : end]


def _lines(path: Path) -> list[str]:
    return joined_lines(read_text(path))


def _triangles(path: Path, vertices: np.ndarray, statements: _Statements) -> _Triangles:
    polygons = statements.polygons
    if all(len(polygon) == 3 for polygon in polygons):
        faces = np.array(polygons, dtype=np.int64)
        texture_vertices = np.array(statements.polygon_texture_vertices, dtype=np.int64)
        normals = np.array(statements.polygon_normals, dtype=np.int64)
        return _Triangles(faces, texture_vertices, normals, np.arange(len(faces)))
    try:
        places, polygon = triangulated(vertices, polygons)
    except ValueError as problem:
        raise InputError(
            str(path), f"holds {problem}", "Triangulate the mesh before it is exported"
        ) from problem
    return _Triangles(
        np.concatenate(polygons).astype(np.int64)[places],
        np.concatenate(statements.polygon_texture_vertices).astype(np.int64)[places],
        np.concatenate(statements.polygon_normals).astype(np.int64)[places],
        polygon,
    )


def _corner_coordinates(statements: _Statements, triangles: _Triangles) -> np.ndarray:
    if not statements.texture_vertices:
        return np.full((len(triangles.faces), 3, 2), np.nan)
    pairs = [[*row, 0.0][:2] for row in statements.texture_vertices]
    table = np.array([*pairs, [np.nan, np.nan]], dtype=np.float64)
    return table[triangles.texture_vertices]


def _corner_normals(statements: _Statements, triangles: _Triangles) -> np.ndarray | None:
    if not statements.normals:
        return None
    return np.array([*statements.normals, [0.0, 0.0, 0.0]], dtype=np.float64)[triangles.normals]


def _parse(path: Path) -> _Statements:
    statements = _Statements()
    material: str | None = None
    for number, line in enumerate(_lines(path), start=1):
        keyword, *values = line.split("#", 1)[0].split() or [""]
        try:
            if keyword == "v":
                statements.vertices.append(_floats(values, 3))
            elif keyword == "vt":
                statements.texture_vertices.append(_floats(values, 1))
            elif keyword == "vn":
                statements.normals.append(_floats(values, 3)[:3])
            elif keyword in ("f", "fo"):
                _append_polygon(statements, values, material, number)
            elif keyword == "usemtl":
                material = unquoted(" ".join(line.split()[1:]))
            elif keyword == "mtllib":
                statements.libraries.append(line.split(maxsplit=1)[1].strip())
            elif keyword in _LEFT_OUT:
                statements.left_out[f"{_LEFT_OUT[keyword]} ({keyword}) are left out"] = None
        except (ValueError, IndexError) as problem:
            raise _unreadable(path, number, problem, line) from problem
    _resolve(path, statements)
    return statements


def _unreadable(path: Path, number: int, problem: object, line: str) -> InputError:
    return InputError(
        f"{path} line {number}",
        f"cannot be read as Wavefront OBJ ({brief(problem)}): {line[:60]!r}",
        "Export the mesh again",
    )


def _floats(values: list[str], least: int) -> list[float]:
    if len(values) < least:
        raise ValueError(f"{len(values)} numbers where {least} are needed")
    return [float(value) for value in values]


def _append_polygon(statements: _Statements, corners: list[str], material: str | None, number: int) -> None:
    """Keep the indices of a face from 1 on, negative ones counted back from the last row so far; 0: none."""
    if len(corners) < 3:
        raise ValueError("a face needs three corners")
    vertex_indices, texture_indices, normal_indices = [], [], []
    for corner in corners:
        parts = corner.split("/")
        texture, normal = [*parts[1:3], "", ""][:2]
        vertex_indices.append(_counted(parts[0], len(statements.vertices), "vertex"))
        texture_indices.append(
            _counted(texture or "0", len(statements.texture_vertices), "texture coordinate")
        )
        normal_indices.append(_counted(normal or "0", len(statements.normals), "normal"))
    statements.polygons.append(vertex_indices)
    statements.polygon_texture_vertices.append(texture_indices)
    statements.polygon_normals.append(normal_indices)
    statements.polygon_materials.append(material)
    statements.lines.append(number)


def _counted(written: str, count: int, kind: str) -> int:
    index = int(written)
    if index < 0 and (index := count + 1 + index) < 1 and count:
        raise ValueError(f"{kind} {written} of {count} defined so far")
    return max(index, 0)


def _resolve(path: Path, statements: _Statements) -> None:
    """Turn indices from 1 on into rows; those of tables that are not there, and 0, into -1.

    -1 is the last row of a table: NaN for texture coordinates, zero for normals.
    """
    count = len(statements.vertices)
    from_zero = any(0 in polygon for polygon in statements.polygons)
    if from_zero and any(max(polygon) >= count for polygon in statements.polygons):
        first = next(index for index, polygon in enumerate(statements.polygons) if 0 in polygon)
        raise InputError(
            f"{path} line {statements.lines[first]}",
            f"cannot be read as Wavefront OBJ (vertex 0 of {count}, and others count from 1)",
            "Export the mesh again: indices count from 1",
        )
    for loops, rows, kind, absent in (
        (statements.polygons, count, "vertex", False),
        (statements.polygon_texture_vertices, len(statements.texture_vertices), "texture coordinate", True),
        (statements.polygon_normals, len(statements.normals), "normal", True),
    ):
        shift = 0 if from_zero and not absent else 1
        for number, loop in enumerate(loops):
            if absent and not rows:
                loop[:] = [-1] * len(loop)
            elif max(loop) >= rows + shift:
                fault = f"{kind} {max(loop)} of {rows}"
                raise InputError(
                    f"{path} line {statements.lines[number]}",
                    f"cannot be read as Wavefront OBJ ({fault})",
                    "Export the mesh again",
                )
            else:
                loop[:] = [index - shift for index in loop]


def _materials(
    path: Path, statements: _Statements, remarks: list[str]
) -> tuple[list[ObjMaterial], np.ndarray]:
    """Materials in order of first use, and the index of each polygon's."""
    materials: dict[str, ObjMaterial] = {}
    libraries = list(dict.fromkeys(statements.libraries))
    if len(libraries) > MOST_LIBRARIES:
        raise InputError(
            str(path),
            f"names {len(libraries)} material libraries, more than {MOST_LIBRARIES}",
            "Join them, or name a texture for the object",
        )
    for library in libraries:
        materials |= read_material_library(path, library)
    names = list(dict.fromkeys(statements.polygon_materials))
    index_of = {name: index for index, name in enumerate(names)}
    return (
        [_material(path, materials, name, remarks, has_library=bool(statements.libraries)) for name in names],
        np.array([index_of[name] for name in statements.polygon_materials], dtype=np.int32),
    )


def _without_colour(statements: _Statements) -> list[str]:
    """A sentence where a file speaks of colours and names none."""
    if statements.libraries or any(len(row) >= 6 for row in statements.vertices):
        return []
    if any(statements.polygon_materials):
        return ["it uses materials and names no library of them (mtllib): it is drawn grey"]
    if statements.texture_vertices:
        return ["it has texture coordinates and names no picture: it is drawn grey; state the texture"]
    return []


def _material(
    path: Path, materials: dict[str, ObjMaterial], name: str | None, remarks: list[str], *, has_library: bool
) -> ObjMaterial:
    """The material of a name; of None, the only one there is.

    Raises
    ------
    InputError
        A name that no library defines, or None where there are several.
    """
    written = name or ""
    alike = [written, without_comment(written)]
    alike += [spelling for spelling in materials if written and spelling.casefold() == written.casefold()]
    for candidate in alike:
        if candidate in materials and (candidate or len(materials) == 1):
            return materials[candidate]
    if not has_library:
        return ObjMaterial()
    distinct = list({id(material): key for key, material in materials.items()}.values())
    nameless = name is None or written.casefold() in _NAMELESS
    if nameless and len(distinct) <= 1:
        if distinct:
            remarks.append(
                "it uses no material by name (usemtl): the only one of its library, "
                f"{shortened(distinct[0])}, is taken"
            )
            return materials[distinct[0]]
        remarks.append("its material library defines no material: it is drawn grey")
        return ObjMaterial()
    choices = ", ".join(map(shortened, sorted(distinct)[:3])) or "none"
    choices += ", ..." if len(distinct) > 3 else ""
    if name is None:
        finding = f"has faces before any usemtl, and its material library has several materials ({choices})"
        raise InputError(
            str(path), finding, "Write a usemtl before the faces, or name a texture for the object"
        )
    raise InputError(
        str(path),
        f"uses the material {shortened(written)}, which its material library does not define (it has: "
        f"{choices})",
        "Add it to the library, or name a texture for the object",
    )


def _colour_image(material: ObjMaterial, reader: TextureReader) -> np.ndarray:
    """Base colour RGBA, opaque but where the material asks for transparency."""
    if material.texture is not None:
        texture = opaque(reader.file(material.texture))
    else:
        texture = uniform_texture(material.colour)
    factor = 1.0 if material.opacity is None else material.opacity
    if material.opacity_map is not None:
        alpha = _levels(material.opacity_map, reader, of_opacity=True)
        return with_alpha(texture, scaled_map(alpha, factor))
    return texture if factor == 1.0 else with_alpha(texture, uniform_map(factor))


def _scalar_image(image: ScalarMap | None, value: float | None, reader: TextureReader) -> np.ndarray | None:
    """Roughness or metallic (h, w) of an image, else of a value; None where there is neither."""
    if image is not None:
        return reader.count(_levels(image, reader, of_opacity=False))
    return None if value is None else uniform_map(value)


def _normal_image(material: ObjMaterial, reader: TextureReader) -> np.ndarray | None:
    """Normals (h, w, 3) in tangent space; None where the material has none, or heights."""
    image = None
    if material.normal_map is not None:
        image = reader.file(material.normal_map)
    elif material.bump_map is not None and holds_normals(bumps := reader.file(material.bump_map)):
        image = bumps
    normals = None if image is None else scaled_normals(image, material.bump_scale)
    return None if normals is None else reader.count(normals)


def _levels(image: ScalarMap, reader: TextureReader, *, of_opacity: bool) -> np.ndarray:
    """(h, w) uint8 of the channel that holds the quantity."""
    rgba = reader.file(image.file)
    if image.channel is not None:
        return np.ascontiguousarray(rgba[..., image.channel])
    in_alpha = of_opacity and bool((rgba[..., 3] < 255).any())
    return np.ascontiguousarray(rgba[..., 3 if in_alpha else 0])
