"""Objects whose files are damaged or hostile, made by code from a seed."""

import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from hard_checks import PICTURE
from hard_meshes import (
    BOX_QUADS,
    OBJ_SIDES,
    QUAD_CORNERS,
    GltfWriter,
    box,
    box_corners,
    encoded,
    fanned,
    ply_bytes,
    quarters,
    stl_bytes,
    stl_text,
    write_gltf_box,
    write_obj_box,
    write_text,
)

Random = np.random.Generator
Mutator = Callable[[bytes, Random], bytes]
Built = tuple[Path, list[Path]]
"""The mesh of an object, and the files of it to be mutated."""


# Objects to start from


def _obj(folder: Path) -> Built:
    path = write_obj_box(folder)
    return path, [path]


def _library(folder: Path) -> Built:
    path = write_obj_box(folder, library="newmtl skin\nKd 1 1 1\nd 0.9\nPr 0.5\nmap_Kd -s 1 1 1 skin.png\n")
    return path, [path.with_name("model.mtl")]


def _picture(kind: str, **options: Any) -> Callable[[Path], Built]:
    def build(folder: Path) -> Built:
        path = write_obj_box(folder)
        picture = path.with_name("skin.png")
        picture.write_bytes(encoded(quarters(), kind, **options))
        return path, [picture]

    return build


def _gltf(folder: Path) -> Built:
    write_text(folder / "meshes" / "skin.png", PICTURE)
    path = write_gltf_box(folder / "meshes" / "model.gltf", image="skin.png", scale=[1, 2, 1])
    return path, [path]


def _buffer(folder: Path) -> Built:
    path = write_gltf_box(folder / "meshes" / "model.gltf")
    return path, [path.with_name("model.bin")]


def _glb(folder: Path) -> Built:
    path = write_gltf_box(folder / "meshes" / "model.glb")
    return path, [path]


def _draco(folder: Path) -> Built:
    import DracoPy

    def change(writer: GltfWriter, primitive: dict[str, Any]) -> None:
        positions, _, indices = box_corners(OBJ_SIDES)
        data = DracoPy.encode(
            positions.astype("<f4"), indices.reshape(-1, 3).astype(np.uint32), preserve_order=True
        )
        number = DracoPy.decode(data).attributes[0]["unique_id"]
        said = {"bufferView": writer.view(data), "attributes": {"POSITION": number}}
        primitive |= {"extensions": {"KHR_draco_mesh_compression": said}, "attributes": {
            "POSITION": writer.accessor(positions.astype("<f4"), view=-1)}}  # fmt: skip
        del primitive["material"]
        writer.needs("KHR_draco_mesh_compression")

    path = write_gltf_box(folder / "meshes" / "model.gltf", change)
    return path, [path.with_name("model.bin")]


def _ply(order: str) -> Callable[[Path], Built]:
    def build(folder: Path) -> Built:
        polygons = [*BOX_QUADS[:3], *fanned(BOX_QUADS[3:]).tolist()]
        corners = [QUAD_CORNERS[: len(polygon)] for polygon in polygons]
        data = ply_bytes(box(OBJ_SIDES), polygons, order, corners=corners, comments=["TextureFile skin.png"])
        write_text(folder / "meshes" / "skin.png", PICTURE)
        path = write_text(folder / "meshes" / "model.ply", data)
        return path, [path]

    return build


def _stl(folder: Path) -> Built:
    path = write_text(folder / "meshes" / "model.stl", stl_bytes(box(OBJ_SIDES), fanned(BOX_QUADS)))
    return path, [path]


def _stl_text(folder: Path) -> Built:
    path = write_text(folder / "meshes" / "model.stl", stl_text(box(OBJ_SIDES), fanned(BOX_QUADS)))
    return path, [path]


def _zip(folder: Path) -> Built:
    """The archive of a scan; its mesh is there when it has been unpacked beside it."""
    inside = folder / "packed"
    mesh, _ = _obj(inside)
    archive = folder / "scan.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for path in sorted(inside.rglob("*")):
            if path.is_file():
                file.write(path, path.relative_to(inside).as_posix())
                path.unlink()
    return folder / "unpacked" / mesh.relative_to(inside), [archive]


OBJECTS: dict[str, Callable[[Path], Built]] = {
    "OBJ": _obj,
    "MTL": _library,
    "PNG": _picture("PNG"),
    "JPEG": _picture("JPEG"),
    "webp": _picture("WEBP", lossless=True),
    "TIFF": _picture("TIFF", compression="tiff_lzw"),
    "TGA": _picture("TGA", compression="tga_rle"),
    "GIF": _picture("GIF"),
    "glTF": _gltf,
    "bin": _buffer,
    "GLB": _glb,
    "Draco": _draco,
    "PLY": _ply("<"),
    "PLY, big endian": _ply(">"),
    "PLY, text": _ply(""),
    "STL": _stl,
    "STL, text": _stl_text,
    "zip": _zip,
}


# What may happen to a file

NUMBERS = (
    b"0", b"-1", b"-0", b"1e999", b"nan", b"-inf", b"1e308", b"1e-320", b"4294967295", b"2147483648",
    b"99999999999999999999", b"9" * 5000, b"1e15", b"0x10", b"1_000", b"true", b"null", b"1000000", b"3.5",
)  # fmt: skip
NAMES = (
    b"../../outside.png", b"../../../../../../etc/passwd", b"/etc/passwd", b"file:///etc/passwd",
    b"http://localhost:1/x.png", b"..\\..\\outside.png", b"C:\\outside.png", b"~/x", b"", b".", b"..",
    b"a" * 5000, b"\x00", b"%2e%2e/%2e%2e/outside.png", b"data:image/png;base64,AAAA", b"/dev/zero",
    b"/dev/stdin", b"/proc/self/environ", b"model.obj", b"model.gltf", b"con.png", b"\xff\xfe", b"|ls",
)  # fmt: skip
WORDS = (
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\0\0\0\0",
    b"\0\0\0\x80",
    b"\0\0\xc0\x7f",
    b"\0\0\x80\x7f",
)
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:e[+-]?\d+)?")
_NAME = re.compile(rb"[\w.%-]+\.(?:png|mtl|bin|obj|webp|jpg)")


def _place(data: bytes, random: Random) -> int:
    return int(random.integers(0, len(data) + 1))


def bits_flipped(data: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(int(random.integers(1, 12))):
        if changed:
            changed[int(random.integers(len(changed)))] ^= 1 << int(random.integers(8))
    return bytes(changed)


def cut(data: bytes, random: Random) -> bytes:
    return data[: _place(data, random)]


def spliced(data: bytes, random: Random) -> bytes:
    """A part of the file in place of another, of another length."""
    a, b, c, d = (_place(data, random) for _ in range(4))
    return data[:a] + data[min(b, c) : max(b, c)] + data[d:]


def repeated(data: bytes, random: Random) -> bytes:
    a, b = sorted(_place(data, random) for _ in range(2))
    return data[:b] + data[a:b] * int(random.integers(1, 50)) + data[b:]


def _replaced(pattern: re.Pattern[bytes], by: tuple[bytes, ...]) -> Mutator:
    def mutate(data: bytes, random: Random) -> bytes:
        for _ in range(int(random.integers(1, 4))):
            matches = list(pattern.finditer(data))
            if not matches:
                return bits_flipped(data, random)
            match = matches[int(random.integers(len(matches)))]
            data = data[: match.start()] + by[int(random.integers(len(by)))] + data[match.end() :]
        return data

    return mutate


def word_replaced(data: bytes, random: Random) -> bytes:
    place = 4 * (_place(data, random) // 4) if random.random() < 0.5 else _place(data, random)
    return data[:place] + WORDS[int(random.integers(len(WORDS)))] + data[place + 4 :]


def inserted(data: bytes, random: Random) -> bytes:
    what = (
        b"[" * 100_000,
        b"\0" * 1000,
        b"\n" * 10_000,
        b'{"a":' * 5000,
        b"\x1a",
        b"\xef\xbb\xbf",
        b"f 1 2 3 " * 999,
    )
    place = _place(data, random)
    return data[:place] + what[int(random.integers(len(what)))] + data[place:]


def lines_shuffled(data: bytes, random: Random) -> bytes:
    lines = data.split(b"\n")
    some = random.permutation(len(lines))[: int(random.integers(1, len(lines) + 1))]
    rows = np.sort(some) if random.random() < 0.5 else some
    return b"\n".join(lines[index] for index in rows)


def tree_changed(data: bytes, random: Random) -> bytes:
    """JSON with some values replaced by others, by parts of itself, or left out."""
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return bits_flipped(data, random)
    odd = [None, -1, 0, 1, 2**40, 1.5, 1e300, True, "", "x", [], {}, [0], [[]], {"a": 1}, "0", 10**30]
    for _ in range(int(random.integers(1, 4))):
        spots = list(_spots(tree)) if isinstance(tree, dict | list) else []
        if not spots:
            return bits_flipped(data, random)
        holder, key = spots[int(random.integers(len(spots)))]
        choice = random.random()
        if choice < 0.25 and isinstance(holder, dict):
            del holder[key]
        elif choice < 0.5:
            source, name = spots[int(random.integers(len(spots)))]
            if name in source if isinstance(source, dict) else name < len(source):
                holder[key] = json.loads(json.dumps(source[name]))
        else:
            holder[key] = odd[int(random.integers(len(odd)))]
    return json.dumps(tree).encode()


def _spots(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every place of a JSON tree: what holds it, and its key or index."""
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
        yield tree, key
        if isinstance(tree[key], dict | list):
            yield from _spots(tree[key])


def chunks_changed(data: bytes, random: Random) -> bytes:
    """A PNG whose chunks are changed, and their checksums with them."""
    if data[:4] != b"\x89PNG":
        return word_replaced(data, random)
    result, position, chunks = bytearray(data[:8]), 8, []
    while position + 8 <= len(data):
        (length,) = struct.unpack(">I", data[position : position + 4])
        chunks.append((data[position + 4 : position + 8], data[position + 8 : position + 8 + length]))
        position += 12 + length
    if not chunks:
        return bits_flipped(data, random)
    target = int(random.integers(len(chunks)))
    for index, (kind, content) in enumerate(chunks):
        if index == target:
            content = (
                bits_flipped(content, random) if random.random() < 0.7 else word_replaced(content, random)
            )
        result += struct.pack(">I", len(content)) + kind + content
        result += struct.pack(">I", zlib.crc32(kind + content))
    return bytes(result)


MUTATORS: dict[str, Mutator] = {
    "bits": bits_flipped,
    "cut": cut,
    "spliced": spliced,
    "repeated": repeated,
    "numbers": _replaced(_NUMBER, NUMBERS),
    "names": _replaced(_NAME, NAMES),
    "words": word_replaced,
    "inserted": inserted,
    "lines": lines_shuffled,
    "tree": tree_changed,
    "chunks": chunks_changed,
}
_TEXTS = ("bits", "cut", "spliced", "repeated", "numbers", "numbers", "names", "inserted", "lines")
_FITTING = {
    "OBJ": _TEXTS, "MTL": _TEXTS, "STL, text": _TEXTS, "PLY, text": _TEXTS,
    "glTF": (*_TEXTS, "tree", "tree", "tree", "tree"),
    "PNG": ("bits", "cut", "spliced", "words", "chunks", "chunks", "chunks"),
}  # fmt: skip
_BYTES = ("bits", "bits", "cut", "spliced", "repeated", "words", "words", "numbers", "names")


def write_mutated(folder: Path, seed: int) -> dict[str, str]:
    """Write the object of a seed to `folder`/object; beside it lies a picture that nobody may read.

    Returns
    -------
    dict
        Its kind, what was done, its mesh, and the archive it must be unpacked from first, if any.
    """
    random = np.random.default_rng(seed)
    kind = list(OBJECTS)[seed % len(OBJECTS)]
    mesh, targets = OBJECTS[kind](folder / "object")
    write_text(folder / "outside.png", PICTURE)
    done = []
    for _ in range(1 if random.random() < 0.7 else 2):
        names = _FITTING.get(kind, _BYTES)
        name = names[int(random.integers(len(names)))]
        for target in targets:
            target.write_bytes(MUTATORS[name](target.read_bytes(), random))
        done.append(name)
    archive = str(targets[0]) if kind == "zip" else ""
    return {"kind": kind, "done": " ".join(done), "mesh": str(mesh), "archive": archive, "seed": str(seed)}
