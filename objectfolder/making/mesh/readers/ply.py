"""PLY, as text or binary of either byte order, polygons, colours and texture coordinates included.

Read here and not with trimesh, which reads binary faces as if all had as many corners as the first, and cuts
polygons without regard to their shape.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import (
    find_file,
    read_bytes,
    refuse_coarse,
    refuse_unusable,
    single_precision_step,
    unreadable,
    usual_places,
)
from objectfolder.making.mesh.readers.material_library import DEFAULT_COLOUR
from objectfolder.making.mesh.readers.polygons import triangulated
from objectfolder.making.mesh.readers.textures import (
    corner_colour_atlas,
    opaque,
    read_texture,
    uniform_texture,
)
from objectfolder.making.mesh.readers.vertex_colours import alpha_remark, colour_fractions
from objectfolder.surface.textured_mesh import TexturedMesh

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_LONGEST_HEADER_BYTES = 2**16
_COORDINATES = (
    ("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"), ("tex_u", "tex_v"),
    ("tx", "ty"), ("tu", "tv"),
)  # fmt: skip
_INDICES = ("vertex_indices", "vertex_index")
_NORMALS = ("nx", "ny", "nz")
_COLOURS = (
    ("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"),
    ("ambient_red", "ambient_green", "ambient_blue"),
)  # fmt: skip
"""Names in use, the first first."""
_ALPHAS = ("alpha", "a", "diffuse_alpha")


@dataclass(frozen=True)
class _Property:
    name: str
    kind: str
    count_kind: str | None = None


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)


@dataclass(frozen=True)
class _Header:
    byte_order: str
    elements: list[_Element]
    textures: list[str]
    data_start: int


Column = np.ndarray | list[np.ndarray]
"""Values (n,) of a property, lists of equal length (n, k), or lists of any length."""


def read_ply(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read a PLY file as it is, uncleaned; corners without texture coordinates get NaN.

    A texture named in the header (`comment TextureFile`) goes before colours of vertices, these before
    colours of faces; colours are taken as sRGB-encoded, whole numbers as fractions of their type's range.

    Parameters
    ----------
    with_textures
        False leaves texture and colours out (the texture may then be missing).

    Raises
    ------
    InputError
        Not a PLY file, cut short, no faces, an index out of range, a texture that is missing or broken.
    """
    data = read_bytes(path)
    try:
        header = _header(data)
        columns = _columns(data, header)
        positions = [_numbers(columns["vertex"][axis]) for axis in "xyz"]
        face = columns.get("face", {})
        name = next((name for name in _INDICES if name in face), None)
        loops = [] if name is None else [[int(index) for index in loop] for loop in face[name]]
        vertices = np.stack(positions, axis=1).astype(np.float64)
        if any(len(loop) < 3 or min(loop) < 0 or max(loop) >= len(vertices) for loop in loops):
            raise ValueError("a face has fewer than three corners, or names a vertex that is not there")
    except (ValueError, KeyError, IndexError, OverflowError, MemoryError) as problem:
        raise unreadable(path, "PLY", problem) from problem
    if "tristrips" in columns:
        raise InputError(str(path), "has triangle strips, which are not read", "Export it with triangles")
    if not loops:
        raise InputError(str(path), "holds no faces", "Use a PLY file with triangles")
    refuse_unusable(path, vertices)
    if positions[0].dtype.kind == "f" and positions[0].dtype.itemsize == 4:
        refuse_coarse(path, vertices, single_precision_step(vertices))
    try:
        places, polygon = triangulated(vertices, loops)
    except ValueError as problem:
        raise InputError(str(path), f"holds {problem}", "Triangulate the mesh first") from problem
    faces = np.concatenate(loops).astype(np.int64)[places]
    coordinates = _coordinates(path, columns, faces, places)
    texture = uniform_texture(DEFAULT_COLOUR)
    remarks: list[str] = []
    if with_textures and header.textures:
        texture = opaque(read_texture(_texture_file(path, header.textures, columns)))
    elif with_textures:
        colours = _colours(path, columns, faces, polygon, remarks)
        if colours is not None:
            atlas, coordinates = corner_colour_atlas(colours)
            texture = opaque(atlas)
        elif np.isfinite(coordinates).any():
            remarks.append(
                "it has texture coordinates and names no picture: it is drawn grey; state the texture"
            )
        elif "material" in columns:
            remarks.append("its materials are not read: it is drawn grey")
    of_face = np.zeros(len(faces), dtype=np.int32)
    normals = _normals(columns, faces)
    return TexturedMesh(vertices, faces, coordinates, (texture,), of_face, normals, remarks=tuple(remarks))


def _normals(columns: dict[str, dict[str, Column]], faces: np.ndarray) -> np.ndarray | None:
    if not all(axis in columns["vertex"] for axis in _NORMALS):
        return None
    normals = np.stack([_numbers(columns["vertex"][axis]) for axis in _NORMALS], axis=1)
    return normals.astype(np.float64)[faces]


def ply_texture_name(path: Path) -> str | None:
    """Return the first texture that a PLY header names; None where it has none or is no header."""
    try:
        textures = _header(read_bytes(path)).textures
    except (InputError, ValueError, KeyError, IndexError, OverflowError):
        return None
    return textures[0] if textures else None


def _header(data: bytes) -> _Header:
    head = data[:_LONGEST_HEADER_BYTES]
    mark = head.find(b"end_header")
    if data[:3] != b"ply" or mark < 0:
        raise ValueError("it has no header of a PLY file")
    end = mark + len(b"end_header")
    end += 2 if data[end : end + 2] == b"\r\n" else 1
    order: str | None = None
    elements: list[_Element] = []
    textures = []
    for line in head[:mark].replace(b"\r", b"\n").decode("utf-8", errors="replace").split("\n")[1:]:
        words = line.split()
        if words[:1] == ["format"]:
            order = _BYTE_ORDERS[words[1]]
        elif words[:1] == ["comment"] and len(words) > 2 and words[1].lower() == "texturefile":
            textures.append(line.split(words[1], 1)[1].strip())
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2])))
        elif words[:2] == ["property", "list"]:
            elements[-1].properties.append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
    if order is None:
        raise ValueError("its header names no format")
    for element in elements:
        # Each row has a byte at least, in text and in binary.
        if not 0 <= element.count <= len(data) or (element.count and not element.properties):
            raise ValueError(f"it cannot hold {element.count} of {element.name!r}")
    return _Header(order, elements, textures, end)


def _columns(data: bytes, header: _Header) -> dict[str, dict[str, Column]]:
    """Values of each property of each element."""
    columns: dict[str, dict[str, Column]] = {}
    if header.byte_order:
        position = header.data_start
        for element in header.elements:
            columns[element.name], position = _binary(data, position, element, header.byte_order)
        return columns
    words = data[header.data_start :].split()
    position = 0
    for element in header.elements:
        columns[element.name], position = _text(words, position, element)
    return columns


def _binary(data: bytes, start: int, element: _Element, order: str) -> tuple[dict[str, Column], int]:
    """Read rows from `start`, at once where all lists are as long as those of the first row."""
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    position = start
    for index, entry in enumerate(element.properties):
        if entry.count_kind is None:
            fields.append((f"v{index}", order + entry.kind))
            position += np.dtype(entry.kind).itemsize
            continue
        length, position = _list_length(data, position, order + entry.count_kind) if element.count else (0, 0)
        fields += [(f"n{index}", order + entry.count_kind), (f"v{index}", order + entry.kind, (length,))]
        position += length * np.dtype(entry.kind).itemsize
        if position > len(data):
            raise ValueError(f"it ends within {element.name!r}")
    row = np.dtype(fields)
    if start + element.count * row.itemsize <= len(data):
        table = np.frombuffer(data, row, element.count, start)
        counts = [name for name in row.names or () if name[0] == "n"]
        if all((table[name] == row[f"v{name[1:]}"].shape[0]).all() for name in counts):
            values = {entry.name: table[f"v{index}"] for index, entry in enumerate(element.properties)}
            return dict(values), start + element.count * row.itemsize
    return _binary_row_by_row(data, start, element, order)


def _binary_row_by_row(
    data: bytes, position: int, element: _Element, order: str
) -> tuple[dict[str, Column], int]:
    lists: dict[str, list[np.ndarray]] = {entry.name: [] for entry in element.properties}
    for _ in range(element.count):
        for entry in element.properties:
            length = 1
            if entry.count_kind is not None:
                length, position = _list_length(data, position, order + entry.count_kind)
            kind = np.dtype(order + entry.kind)
            if position + length * kind.itemsize > len(data):
                raise ValueError(f"it ends within {element.name!r}")
            lists[entry.name].append(np.frombuffer(data, kind, length, position))
            position += length * kind.itemsize
    return _joined(element, lists), position


def _list_length(data: bytes, position: int, kind: str) -> tuple[int, int]:
    """The length written at `position`, and where its list starts."""
    end = position + np.dtype(kind).itemsize
    if end > len(data):
        raise ValueError("it ends within a list")
    length = int(np.frombuffer(data, kind, 1, position)[0])
    if not 0 <= length <= len(data):
        raise ValueError(f"a list of {length}")
    return length, end


def _text(words: list[bytes], position: int, element: _Element) -> tuple[dict[str, Column], int]:
    lists: dict[str, list[np.ndarray]] = {entry.name: [] for entry in element.properties}
    if all(entry.count_kind is None for entry in element.properties):
        end = position + element.count * len(element.properties)
        if end > len(words):
            raise ValueError(f"it ends within {element.name!r}")
        table = np.array(words[position:end]).astype(np.float64) if end > position else np.zeros(0)
        table = table.reshape(element.count, -1)
        return {
            entry.name: _of_kind(table[:, index], entry.kind)
            for index, entry in enumerate(element.properties)
        }, end
    for _ in range(element.count):
        for entry in element.properties:
            length = 1
            if entry.count_kind is not None:
                length, position = int(words[position]), position + 1
            if not 0 <= length <= len(words) - position:
                raise ValueError(f"it ends within {element.name!r}")
            values = np.array([float(word) for word in words[position : position + length]])
            lists[entry.name].append(_of_kind(values, entry.kind))
            position += length
    return _joined(element, lists), position


def _of_kind(values: np.ndarray, kind: str) -> np.ndarray:
    """Numbers as the type that the header gives them."""
    dtype = np.dtype(kind)
    if dtype.kind == "f":
        # Text has more digits than single precision; the colours' type is all that is asked of it.
        return values
    information = np.iinfo(dtype)
    if not (
        np.isfinite(values).all() and (values >= information.min).all() and (values <= information.max).all()
    ):
        raise ValueError("a number is out of the range of its type")
    return values.astype(dtype)


def _joined(element: _Element, lists: dict[str, list[np.ndarray]]) -> dict[str, Column]:
    return {
        entry.name: lists[entry.name]
        if entry.count_kind is not None
        else np.concatenate(
            [np.zeros(0, lists[entry.name][0].dtype if lists[entry.name] else "f8"), *lists[entry.name]]
        )
        for entry in element.properties
    }


def _numbers(column: Column) -> np.ndarray:
    if isinstance(column, list) or column.ndim != 1:
        raise ValueError("a list where a number is needed")
    return column


def _coordinates(
    path: Path, columns: dict[str, dict[str, Column]], faces: np.ndarray, places: np.ndarray
) -> np.ndarray:
    """Texture coordinates (F, 3, 2): of the corners of faces, else of vertices, else NaN."""
    if "texcoord" in columns["face"]:
        listed = columns["face"]["texcoord"]
        pairs = np.concatenate([np.asarray(row, dtype=np.float64) for row in listed])
        loops = columns["face"][next(name for name in _INDICES if name in columns["face"])]
        if all(len(row) == 2 * len(loop) for row, loop in zip(listed, loops, strict=True)):
            return pairs.reshape(-1, 2)[places]
        raise InputError(
            str(path), "has faces with other than two texture coordinates a corner", "Export the mesh again"
        )
    vertex = columns["vertex"]
    for u, v in _COORDINATES:
        if u in vertex and v in vertex:
            table = np.stack([np.asarray(vertex[u]), np.asarray(vertex[v])], axis=1).astype(np.float64)
            return table[faces]
    return np.full((len(faces), 3, 2), np.nan)


def _texture_file(path: Path, names: list[str], columns: dict[str, dict[str, Column]]) -> Path:
    if len(set(names)) > 1:
        number = columns["face"].get("texnumber")
        used = {0} if number is None else {int(value) for value in np.asarray(number)}
        if len(used) > 1:
            raise InputError(
                str(path),
                f"has {len(used)} textures, of which PLY is read with one",
                "Export it as OBJ or glTF",
            )
        names = names[min(used) :][:1] or names
    file = find_file(path.parent, usual_places(names[0]), within=path.parent)
    if file is None:
        raise InputError(
            str(path.parent / names[0][:100]),
            "the texture file does not exist",
            "Correct the path or add the file",
        )
    return file


def _colours(
    path: Path,
    columns: dict[str, dict[str, Column]],
    faces: np.ndarray,
    polygon: np.ndarray,
    remarks: list[str],
) -> np.ndarray | None:
    """RGBA (F, 3, 4) in 0..1 of vertices, else, or where these are all alike, of faces."""
    choices: list[tuple[str, np.ndarray]] = []
    for element, rows in (("vertex", faces), ("face", np.repeat(polygon[:, None], 3, axis=1))):
        by_name = {name.lower(): column for name, column in columns[element].items()}
        for names in _COLOURS:
            if all(name in by_name for name in names):
                channels = np.stack([_numbers(by_name[name]) for name in names], axis=1)
                colours = np.ones((len(channels), 4))
                colours[:, :3] = colour_fractions(path, channels)
                remarks += alpha_remark([by_name[name] for name in _ALPHAS if name in by_name])
                choices.append((element, colours[rows]))
                break
    if len(choices) == 2:
        alike = (choices[0][1] == choices[0][1][0, 0]).all()
        choices = choices[int(alike) :]
        kind = "faces" if alike else "vertices"
        remarks.append(f"it has colours of vertices and of faces: those of {kind} are taken")
    return choices[0][1] if choices else None
