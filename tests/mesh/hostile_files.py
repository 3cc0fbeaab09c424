"""Files made to exhaust who reads them: each small, each asking for very much."""

import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from hard_meshes import (
    BOX_QUADS,
    OBJ_SIDES,
    GltfWriter,
    box,
    box_primitive,
    encoded,
    fanned,
    obj_text,
    quarters,
    stl_bytes,
    write_gltf_box,
    write_obj_box,
    write_text,
)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png_of(width: int, height: int, *, rows: int | None = None, interlaced: bool = False) -> bytes:
    """A grey PNG that says its size and holds this number of black rows, in a few bytes each."""
    packed = zlib.compressobj(9)
    line = bytes(1 + (width + 7) // 8)
    count = height if rows is None else rows
    content = b"".join(packed.compress(line) for _ in range(count)) + packed.flush()
    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, int(interlaced))
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", head) + _chunk(b"IDAT", content) + _chunk(b"IEND", b"")


def _textured(picture: Callable[[], bytes]) -> Callable[[Path], Path]:
    def build(folder: Path) -> Path:
        path = write_obj_box(folder)
        path.with_name("skin.png").write_bytes(picture())
        return path

    return build


def webp_canvas(width: int, height: int) -> bytes:
    """A webp whose header has a canvas of this size, around a picture of 32 texels a side."""
    data = encoded(quarters(), "WEBP", lossless=True)
    size = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
    head = b"VP8X" + struct.pack("<I", 10) + bytes([0x02, 0, 0, 0]) + size
    body = b"WEBP" + head + data[12:]
    return b"RIFF" + struct.pack("<I", len(body)) + body


def jpeg_of(width: int, height: int) -> bytes:
    data = bytearray(encoded(quarters(), "JPEG"))
    place = data.index(b"\xff\xc0") + 5
    data[place : place + 4] = struct.pack(">HH", height, width)
    return bytes(data)


def _gltf(change: Callable[[GltfWriter, dict[str, Any]], None]) -> Callable[[Path], Path]:
    return lambda folder: write_gltf_box(folder / "meshes" / "model.gltf", change)


def _header(**entries: Any) -> Callable[[Path], Path]:
    return _gltf(lambda writer, primitive: writer.header.update(entries))


def _first(kind: str, **entries: Any) -> Callable[[Path], Path]:
    return _gltf(lambda writer, primitive: writer.header[kind][0].update(entries))


def _sparse(count: int) -> Callable[[Path], Path]:
    """Positions without bytes, none of which are overwritten."""
    nothing = {
        "count": 0,
        "indices": {"bufferView": 0, "componentType": 5125},
        "values": {"bufferView": 0},
    }

    def change(writer: GltfWriter, primitive: dict[str, Any]) -> None:
        accessor = writer.header["accessors"][primitive["attributes"]["POSITION"]]
        del accessor["bufferView"]
        accessor |= {"count": count, "sparse": nothing}

    return _gltf(change)


def _many_nodes(folder: Path) -> Path:
    """Twenty thousand nodes that all show the same ten thousand triangles."""
    writer = GltfWriter()
    positions = writer.accessor(box(OBJ_SIDES).astype("<f4"))
    indices = writer.accessor(np.tile(fanned(BOX_QUADS).reshape(-1), 900).astype("<u2"))
    mesh = writer.mesh({"attributes": {"POSITION": positions}, "indices": indices})
    writer.header["nodes"] = [{"mesh": mesh}] * 20_000
    writer.header["scenes"][0]["nodes"] = list(range(20_000))
    return writer.write(folder / "meshes" / "model.gltf")


def _doubling_nodes(folder: Path) -> Path:
    """Forty nodes, each twice the child of the one before: two to the fortieth paths."""
    writer = GltfWriter()
    mesh = writer.mesh(box_primitive(writer))
    writer.header["nodes"] = [{"mesh": mesh, "children": [i + 1, i + 1]} for i in range(40)] + [
        {"mesh": mesh}
    ]
    writer.header["scenes"][0]["nodes"] = [0]
    return writer.write(folder / "meshes" / "model.gltf")


def _deep_nodes(folder: Path) -> Path:
    """A chain of ten thousand nodes, which is a tree and right."""
    writer = GltfWriter()
    mesh = writer.mesh(box_primitive(writer))
    writer.header["nodes"] = [{"children": [i + 1]} for i in range(10_000)] + [{"mesh": mesh}]
    writer.header["scenes"][0]["nodes"] = [0]
    return writer.write(folder / "meshes" / "model.gltf")


def _json(text: str) -> Callable[[Path], Path]:
    return lambda folder: write_text(folder / "meshes" / "model.gltf", text)


def _obj(text: str) -> Callable[[Path], Path]:
    return lambda folder: write_text(folder / "meshes" / "model.obj", text)


def _ply(header: str, rows: bytes = b"") -> Callable[[Path], Path]:
    data = ("ply\nformat binary_little_endian 1.0\n" + header + "end_header\n").encode() + rows
    return lambda folder: write_text(folder / "meshes" / "model.ply", data)


def _names_itself(folder: Path) -> Path:
    """A library that is the mesh, whose texture is the library, and a buffer that is the glTF file."""
    path = write_obj_box(folder, mtllib="model.obj")
    path.write_text(path.read_text() + "newmtl skin\nmap_Kd model.obj\n")
    return path


VERTICES = "property float x\nproperty float y\nproperty float z\n"
BOX_TEXT = obj_text(box(OBJ_SIDES), BOX_QUADS, material="")
HOSTILE: dict[str, Callable[[Path], Path]] = {
    "PNG of 16384 x 16384": _textured(lambda: png_of(16384, 16384, rows=0)),
    "PNG of 12000 x 11000, black": _textured(lambda: png_of(12000, 11000)),
    "PNG of 8192 x 8192, black": _textured(lambda: png_of(8192, 8192)),
    "PNG of two billion a side": _textured(lambda: png_of(2**31 - 1, 2**31 - 1, rows=0)),
    "PNG with more rows than it says": _textured(lambda: png_of(64, 8, rows=500_000)),
    "PNG of 12000 x 11000, interlaced": _textured(lambda: png_of(12000, 11000, rows=3, interlaced=True)),
    "JPEG of 65500 a side": _textured(lambda: jpeg_of(65500, 65500)),
    "JPEG of 16000 x 8000": _textured(lambda: jpeg_of(16000, 8000)),
    "webp of a large canvas": _textured(lambda: webp_canvas(16384, 16384)),
    "webp of a canvas of 2^32": _textured(lambda: webp_canvas(2**24, 2**8)),
    "JSON nested deeply": _json("[" * 1_000_000),
    "JSON nested deeply inside": _json(
        '{"asset":{"version":"2.0"},"nodes":' + "[" * 500_000 + "]" * 500_000 + "}"
    ),
    "JSON of long numbers": _json('{"asset":{"version":"2.0"},"scene":' + "9" * 1_000_000 + "}"),
    "JSON of NaN": _json('{"asset":{"version":"2.0"},"nodes":[{"scale":[NaN,1,1]}]}'),
    "many nodes of a mesh": _many_nodes,
    "nodes that double": _doubling_nodes,
    "deep nodes": _deep_nodes,
    "accessor of 10^12": _first("accessors", count=10**12),
    "sparse accessor of 10^12": _sparse(10**12),
    "sparse accessor of 20 million": _sparse(20_000_000),
    "buffer of 10^15": _first("bufferViews", byteLength=10**15),
    "buffer that is the file": _json(json.dumps({
        "asset": {"version": "2.0"}, "buffers": [{"uri": "model.gltf", "byteLength": 100}],
        "bufferViews": [{"buffer": 0, "byteLength": 100}],
        "accessors": [{"bufferView": 0, "componentType": 5121, "type": "VEC3", "count": 30}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}],
    })),
    "scale of 1e30": _first("nodes", scale=[1e30, 1e30, 1e30]),
    "images without end": _header(images=[{"uri": "data:image/png;base64," + "A" * 4_000_000}]),
    "PLY of four billion vertices": _ply(f"element vertex 4294967295\n{VERTICES}"),
    "PLY of a list of four billion": _ply(
        f"element vertex 3\n{VERTICES}element face 1\nproperty list uint int vertex_indices\n",
        bytes(36) + b"\xff\xff\xff\xff" + bytes(12),
    ),
    "PLY of empty rows": _ply(
        "element vertex 1000000000\nelement face 1\nproperty list uchar int k\n", bytes(9)
    ),
    "PLY of many properties": _ply(
        "element vertex 1\n" + "".join(f"property float p{i}\n" for i in range(3000))
    ),
    "STL of four billion": lambda folder: write_text(
        folder / "meshes" / "model.stl",
        stl_bytes(box(OBJ_SIDES), fanned(BOX_QUADS)).replace(struct.pack("<I", 12), b"\xff\xff\xff\xff"),
    ),
    "OBJ of one face of 300,000 corners": _obj(BOX_TEXT + "f " + "1 2 4 3 " * 75_000),
    "OBJ of 40,000 loose triangles": _obj("".join(
        f"v {i} 0 {i % 7}\nv {i} 1 0\nv {i} 0 1.5\nf -3 -2 -1\n" for i in range(40_000)
    )),
    "OBJ of one line": _obj("v " + "1 " * 3_000_000),
    "OBJ of repeated faces": _obj(BOX_TEXT + "f 1 2 3\nf 1 3 2\n" * 40_000),
    "OBJ of one edge": _obj("v 0 0 0\nv 0 0 1\n" + "".join(f"v 1 {i} 0\nf 1 2 -1\n" for i in range(5000))),
    "OBJ of many materials": _obj("".join(f"usemtl {i}\n" for i in range(200_000)) + BOX_TEXT),
    "OBJ of many libraries": _obj(BOX_TEXT + "mtllib " + "a " * 200_000),
    "OBJ that is its own library": _names_itself,
}  # fmt: skip
