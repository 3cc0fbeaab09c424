"""Files of meshes as users meet them, made by code, each with what is true of the solid in it."""

import io
import json
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

RED, GREEN, BLUE, WHITE = (200, 30, 20), (20, 180, 40), (30, 40, 220), (250, 250, 250)
# Where the top of a textured box shows which quarter of the texture, over half its sides.
QUARTERS = {RED: (-0.5, 0.5), GREEN: (0.5, 0.5), BLUE: (-0.5, -0.5), WHITE: (0.5, -0.5)}

Polygons = list[list[int]]


@dataclass(frozen=True)
class Truth:
    """What loading, cleaning and ingesting a file must find.

    `colours` are sRGB values seen at points of the surface as ingested. `area_m2` and `volume_m3` may differ
    by `tolerance`, relative; extents likewise.
    """

    volume_m3: float | None
    area_m2: float
    extents_m: tuple[float, float, float]
    colours: tuple[tuple[tuple[float, float, float], tuple[int, int, int]], ...] = ()
    components: int = 1
    watertight: bool = True
    faces: int | None = None
    tolerance: float = 1e-9
    length_m: float | None = None


def quarters(size: int = 32) -> np.ndarray:
    """(size, size, 3) uint8: red and green above, blue and white below."""
    image = np.empty((size, size, 3), dtype=np.uint8)
    half = size // 2
    image[:half, :half], image[:half, half:] = RED, GREEN
    image[half:, :half], image[half:, half:] = BLUE, WHITE
    return image


def encoded(image: np.ndarray, kind: str = "PNG", **options: Any) -> bytes:
    data = io.BytesIO()
    Image.fromarray(image).save(data, kind, **options)
    return data.getvalue()


BOX_QUADS: Polygons = [
    [4, 5, 7, 6], [0, 2, 3, 1], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5],
]  # fmt: skip
QUAD_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)


def box(sides: Sequence[float] = (0.1, 0.1, 0.1), centre: Sequence[float] = (0, 0, 0)) -> np.ndarray:
    """Vertices (8, 3) of a box whose outward faces are `BOX_QUADS`; the first is its top (z)."""
    signs = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    return signs * np.asarray(sides, dtype=np.float64) + np.asarray(centre, dtype=np.float64)


def fanned(polygons: Polygons) -> np.ndarray:
    return np.array([[p[0], p[i], p[i + 1]] for p in polygons for i in range(1, len(p) - 1)])


def box_truth(sides: Sequence[float], *, coloured: bool = True, count: int = 1, **more: Any) -> Truth:
    """What is true of a box about the origin, textured by `quarters` on its top."""
    x, y, z = sides
    points = tuple(((u * x / 2, v * y / 2, z / 2), colour) for colour, (u, v) in QUARTERS.items())
    defaults: dict[str, Any] = {
        "volume_m3": count * x * y * z,
        "area_m2": count * 2 * (x * y + y * z + z * x),
        "extents_m": (x, y, z),
        "colours": points if coloured else (),
        "components": count,
    }
    return Truth(**(defaults | more))


def prism(outline: np.ndarray, height: float) -> tuple[np.ndarray, Polygons]:
    """A prism on a polygon (n, 2) counter-clockwise, its two ends whole polygons."""
    count = len(outline)
    vertices = np.array([[x, y, z] for z in (0.0, height) for x, y in outline])
    sides = [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
    return vertices, [list(range(count - 1, -1, -1)), list(range(count, 2 * count)), *sides]


def outline_area(outline: np.ndarray) -> float:
    x, y = outline.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def prism_truth(outline: np.ndarray, height: float, **more: Any) -> Truth:
    around = float(np.linalg.norm(outline - np.roll(outline, -1, axis=0), axis=1).sum())
    area = outline_area(outline)
    width, depth = np.ptp(outline, axis=0)
    return Truth(area * height, 2 * area + around * height, (width, depth, height), **more)


L_OUTLINE = 0.1 * np.array([[1, 1], [1, 2], [0, 2], [0, 0], [2, 0], [2, 1]], dtype=np.float64)
U_OUTLINE = 0.1 * np.array([[2, 3], [2, 1], [1, 1], [1, 3], [0, 3], [0, 0], [3, 0], [3, 3]], dtype=np.float64)


def star_outline(points: int, inner: float = 0.3) -> np.ndarray:
    angle = np.pi * np.arange(2 * points) / points
    radius = np.where(np.arange(2 * points) % 2, inner, 1.0)
    return 0.1 * radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def spiral_outline(turns: float = 2.5, steps: int = 60) -> np.ndarray:
    """A band that winds about the origin: hardly any corner sees another one across."""
    angle = 2 * np.pi * turns * np.arange(steps) / steps
    out = np.stack([(1 + angle) * np.cos(angle), (1 + angle) * np.sin(angle)], axis=1)
    inside = np.stack([(1.8 + angle) * np.cos(angle), (1.8 + angle) * np.sin(angle)], axis=1)
    outline = 0.01 * np.concatenate([inside, out[::-1]])
    return outline if outline_area(outline) > 0 else outline[::-1]


# Written OBJ


def obj_text(
    vertices: np.ndarray,
    polygons: Polygons,
    *,
    head: str = "",
    material: str = "skin",
    textured: bool = True,
    scale_uv: float = 1.0,
    shift_uv: float = 0.0,
    digits: str = ".17g",
) -> str:
    """An OBJ file; quads show the whole texture, other polygons one point of it."""
    lines = [head] if head else []
    lines += ["v " + " ".join(format(value, digits) for value in vertex) for vertex in vertices]
    lines += [f"vt {u * scale_uv + shift_uv} {v * scale_uv + shift_uv}" for u, v in QUAD_CORNERS]
    if material:
        lines.append(f"usemtl {material}")
    for polygon in polygons:
        corners = [f"{vertex + 1}" for vertex in polygon]
        if textured:
            corners = [f"{v}/{i % 4 + 1 if len(polygon) == 4 else 1}" for i, v in enumerate(corners)]
        lines.append("f " + " ".join(corners))
    return "\n".join(lines) + "\n"


def write_obj_box(
    folder: Path,
    *,
    library: str | bytes = "newmtl skin\nmap_Kd skin.png\n",
    image: str = "skin.png",
    mtllib: str = "model.mtl",
    library_file: str = "model.mtl",
    change: Callable[[str], str | bytes] = str,
    **options: Any,
) -> Path:
    """`meshes/model.obj` of a box of 0.1 x 0.08 x 0.06 m with its library and its texture."""
    meshes = folder / "meshes"
    meshes.mkdir(parents=True)
    text = change(obj_text(box(OBJ_SIDES), BOX_QUADS, head=f"mtllib {mtllib}" if mtllib else "", **options))
    path = meshes / "model.obj"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    data = library if isinstance(library, bytes) else library.encode()
    (meshes / library_file).parent.mkdir(parents=True, exist_ok=True)
    (meshes / library_file).write_bytes(data)
    picture = meshes / image
    picture.parent.mkdir(parents=True, exist_ok=True)
    picture.write_bytes(encoded(quarters()))
    return path


OBJ_SIDES = (0.1, 0.08, 0.06)


def write_text(path: Path, text: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


# Written glTF


class GltfWriter:
    """Puts arrays into one buffer and counts what refers to them."""

    def __init__(self) -> None:
        self.blob = bytearray()
        self.header: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "accessors": [],
            "bufferViews": [],
            "meshes": [],
            "nodes": [],
            "scenes": [{"nodes": []}],
            "scene": 0,
        }

    def view(self, data: bytes, **more: Any) -> int:
        self.blob += bytes(-len(self.blob) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data), **more}
        self.header["bufferViews"].append(entry)
        self.blob += data
        return len(self.header["bufferViews"]) - 1

    def accessor(self, array: np.ndarray, *, view: int | None = None, **more: Any) -> int:
        array = np.asarray(array)
        array = array.reshape(len(array), -1)
        kinds = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
        names = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
        entry: dict[str, Any] = {
            "componentType": kinds[array.dtype.str[1:]],
            "count": len(array),
            "type": names[array.shape[1]],
            **more,
        }
        if view is None:
            width = array.shape[1] * array.dtype.itemsize
            padded = -width % 4
            if array.shape[1] > 1 and padded:
                rows = np.zeros((len(array), width + padded), np.uint8)
                rows[:, :width] = np.ascontiguousarray(array).view(np.uint8).reshape(len(array), -1)
                view = self.view(rows.tobytes(), byteStride=width + padded)
            else:
                view = self.view(np.ascontiguousarray(array).tobytes())
        if view >= 0:
            entry["bufferView"] = view
        self.header["accessors"].append(entry)
        return len(self.header["accessors"]) - 1

    def mesh(self, *primitives: dict[str, Any], **more: Any) -> int:
        self.header["meshes"].append({"primitives": list(primitives), **more})
        return len(self.header["meshes"]) - 1

    def node(self, *, root: bool = True, **node: Any) -> int:
        self.header["nodes"].append(node)
        index = len(self.header["nodes"]) - 1
        if root:
            self.header["scenes"][0]["nodes"].append(index)
        return index

    def entry(self, kind: str, **entry: Any) -> int:
        self.header.setdefault(kind, []).append(entry)
        return len(self.header[kind]) - 1

    def material(self, image: bytes | str | None = None, **base: Any) -> int:
        """A material textured by an image in the buffer (bytes) or a file (str)."""
        parts: dict[str, Any] = dict(base)
        if image is not None:
            if isinstance(image, bytes):
                source = self.entry("images", bufferView=self.view(image), mimeType="image/png")
            else:
                source = self.entry("images", uri=image)
            texture = self.entry("textures", source=source)
            parts["baseColorTexture"] = {"index": texture} | parts.get("baseColorTexture", {})
        return self.entry("materials", pbrMetallicRoughness=parts)

    def needs(self, *names: str, used_only: bool = False) -> None:
        for key in ("extensionsUsed", *(() if used_only else ("extensionsRequired",))):
            self.header[key] = [*self.header.get(key, []), *names]

    def write(self, path: Path, *, uri: str = "model.bin") -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".glb":
            self.header["buffers"] = [{"byteLength": len(self.blob)}]
            text = json.dumps(self.header).encode()
            text += b" " * (-len(text) % 4)
            blob = bytes(self.blob) + bytes(-len(self.blob) % 4)
            body = struct.pack("<I4s", len(text), b"JSON") + text
            body += struct.pack("<I4s", len(blob), b"BIN\0") + blob
            path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
        else:
            self.header["buffers"] = [{"byteLength": len(self.blob), "uri": uri}]
            if not uri.startswith("data:"):
                (path.parent / "model.bin").write_bytes(bytes(self.blob))
            path.write_text(json.dumps(self.header))
        return path


def box_corners(sides: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (24, 3), coordinates (24, 2) v down, and indices (36,) of a box with a corner a face."""
    quads = np.array(BOX_QUADS)
    positions = box(sides)[quads].reshape(-1, 3)
    coordinates = np.tile(QUAD_CORNERS * [1, -1] + [0, 1], (6, 1))
    start = 4 * np.arange(6)[:, None]
    indices = (start + np.array([0, 1, 2, 0, 2, 3])).reshape(-1)
    return positions, coordinates, indices


def box_primitive(
    writer: GltfWriter, sides: Sequence[float] = OBJ_SIDES, *, material: int | None = None, **attributes: int
) -> dict[str, Any]:
    """A primitive of a box in single precision; attributes that are given replace its own."""
    positions, coordinates, indices = box_corners(sides)
    accessors = dict(attributes)
    if "POSITION" not in accessors:
        accessors["POSITION"] = writer.accessor(positions.astype("<f4"))
    if "TEXCOORD_0" not in accessors:
        accessors["TEXCOORD_0"] = writer.accessor(coordinates.astype("<f4"))
    primitive: dict[str, Any] = {
        "attributes": accessors,
        "indices": writer.accessor(indices.astype("<u2")),
    }
    if material is not None:
        primitive["material"] = material
    return primitive


def write_gltf_box(
    path: Path,
    change: Callable[[GltfWriter, dict[str, Any]], None] | None = None,
    *,
    image: bytes | str | None = None,
    **node: Any,
) -> Path:
    """A textured box of `OBJ_SIDES`; `change` gets the writer and the primitive before they are written."""
    writer = GltfWriter()
    picture = encoded(quarters()) if image is None else image
    primitive = box_primitive(writer, material=writer.material(picture))
    writer.node(mesh=writer.mesh(primitive), **node)
    if change is not None:
        change(writer, primitive)
    return writer.write(path)


# Written PLY and STL


def ply_bytes(
    vertices: np.ndarray,
    polygons: Polygons,
    order: str = "<",
    *,
    kind: str = "double",
    colours: np.ndarray | None = None,
    face_colours: np.ndarray | None = None,
    corners: list[np.ndarray] | None = None,
    comments: Sequence[str] = (),
    index_name: str = "vertex_indices",
) -> bytes:
    """A PLY file, as text where `order` is empty."""
    formats = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}
    lines = ["ply", f"format {formats[order]} 1.0", *(f"comment {said}" for said in comments)]
    lines += [f"element vertex {len(vertices)}", *(f"property {kind} {axis}" for axis in "xyz")]
    rgb = ("red", "green", "blue")
    lines += [f"property uchar {name}" for name in rgb if colours is not None]
    lines += [f"element face {len(polygons)}", f"property list uchar int {index_name}"]
    lines += ["property list uchar float texcoord"] if corners is not None else []
    lines += [f"property uchar {name}" for name in rgb if face_colours is not None]
    head = ("\n".join([*lines, "end_header"]) + "\n").encode()
    rows: list[list[tuple[Any, str]]] = []
    for index, vertex in enumerate(vertices):
        row = [(value, "f8" if kind == "double" else "f4") for value in vertex]
        row += [(value, "u1") for value in colours[index]] if colours is not None else []
        rows.append(row)
    for index, polygon in enumerate(polygons):
        row = [(len(polygon), "u1"), *((vertex, "i4") for vertex in polygon)]
        if corners is not None:
            row += [(corners[index].size, "u1"), *((value, "f4") for value in corners[index].reshape(-1))]
        row += [(value, "u1") for value in face_colours[index]] if face_colours is not None else []
        rows.append(row)
    if not order:
        return head + ("\n".join(" ".join(f"{v:.17g}" for v, _ in row) for row in rows) + "\n").encode()
    return head + b"".join(np.array(value, order + kind_).tobytes() for row in rows for value, kind_ in row)


def stl_bytes(vertices: np.ndarray, faces: np.ndarray, header: bytes = b"made by code") -> bytes:
    table = np.zeros(len(faces), dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    table["c"] = vertices[faces]
    return header.ljust(80, b"\0")[:80] + struct.pack("<I", len(faces)) + table.tobytes()


def stl_text(vertices: np.ndarray, faces: np.ndarray, name: str = "part") -> str:
    lines = [f"solid {name}"]
    for face in vertices[faces]:
        lines += [" facet normal 0 0 0", "  outer loop"]
        lines += [f"   vertex {x:.9e} {y:.9e} {z:.9e}" for x, y, z in face]
        lines += ["  endloop", " endfacet"]
    return "\n".join([*lines, f"endsolid {name}"]) + "\n"
