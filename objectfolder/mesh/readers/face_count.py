"""How many faces a mesh file has, by its header or its lines, before anything of it is read into memory."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.surface.codec import LARGEST_COUNT

MOST_FACES = 2 * LARGEST_COUNT
"""Some exports give every face twice, and cleaning takes one of each."""

_CHUNK_BYTES = 2**20
_LARGEST_JSON_BYTES = 2**24
_PLY_FACES = re.compile(rb"^element\s+face\s+(\d+)", re.MULTILINE)


def refuse_many_faces(path: Path) -> None:
    """Raise `InputError` for a file with more faces than cleaning can bring below what is held."""
    count = face_count(path)
    if count > MOST_FACES:
        raise InputError(
            str(path),
            f"has {count} faces, and an Object File at most {LARGEST_COUNT}",
            f"Decimate it to {LARGEST_COUNT} faces before: Blender's modifier Decimate does",
        )


def face_count(path: Path) -> int:
    """Count the faces of an OBJ, PLY, binary STL, glTF or GLB file, polygons as one; 0 where nothing says."""
    try:
        with path.open("rb") as file:
            head = file.read(2**16)
        suffix = path.suffix.lower()
        if suffix == ".obj":
            return sum(block.count(b"\nf ") + block.count(b"\nf\t") for block in _blocks(path))
        if suffix == ".ply":
            match = _PLY_FACES.search(head.replace(b"\r", b"\n"))
            return int(match[1]) if match else 0
        if suffix == ".stl":
            count = int.from_bytes(head[80:84], "little")
            return count if path.stat().st_size >= 84 + 50 * count else 0
        return _gltf_faces(path, head)
    except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError):
        return 0  # reading says what is wrong


def _blocks(path: Path) -> Iterator[bytes]:
    """Yield a file in parts; a line's start is in one part with what is before it."""
    with path.open("rb") as file:
        before = b"\n"
        while block := file.read(_CHUNK_BYTES):
            yield before + block
            before = block[-2:] if block[-2:-1] == b"\n" else block[-1:]


def _gltf_faces(path: Path, head: bytes) -> int:
    """Sum the triangles of all primitives, each mesh once."""
    start, size = 0, path.stat().st_size
    if path.suffix.lower() == ".glb":
        start, size = 20, int.from_bytes(head[12:16], "little")
    if size > _LARGEST_JSON_BYTES:
        return 0
    with path.open("rb") as file:
        file.seek(start)
        header = json.loads(file.read(size).decode("utf-8-sig"))
    accessors = header["accessors"]
    primitives = [primitive for mesh in header["meshes"] for primitive in mesh["primitives"]]
    return sum(
        int(accessors[primitive.get("indices", primitive["attributes"]["POSITION"])]["count"]) // 3
        for primitive in primitives
        if primitive.get("mode", 4) == 4
    )
