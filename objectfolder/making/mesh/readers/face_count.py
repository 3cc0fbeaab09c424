"""How many faces a mesh file has, by its header or its lines, before anything of it is read into memory."""

import json
import mmap
import re
from collections.abc import Iterator
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import LARGEST_FILE_BYTES
from objectfolder.products.regular_file import open_regular
from objectfolder.surface.codec import LARGEST_COUNT

MOST_FACES = 2 * LARGEST_COUNT
"""Some exports give every face twice, and cleaning takes one of each."""

_CHUNK_BYTES = 2**20
_LARGEST_JSON_BYTES = 2**24
_OFF_COUNTS = re.compile(rb"^\s*(?:ST)?C?N?OFF\s*(?:#.*\s+)*\d+\s+(\d+)")
_COLLADA_COUNT = re.compile(rb"<(?:triangles|polylist|polygons)\b[^>]*\bcount=\"(\d+)\"")
_PLY_FACES = re.compile(rb"^element\s+face\s+(\d+)", re.MULTILINE)


def refuse_many_faces(path: Path) -> None:
    """Raise `InputError` for a file with more faces than cleaning can bring below what is held."""
    count = face_count(path)
    if count > MOST_FACES:
        raise InputError(
            str(path),
            f"has {count} faces, and an Object File at most {LARGEST_COUNT}",
            "Decimate it: --decimate 50000 of add and build does",
        )


def face_count(path: Path) -> int:
    """Count the faces of a file, polygons as one; 0 where nothing says, as in a text STL."""
    try:
        with open_regular(path) as file:
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
        if suffix == ".off":
            counts = _OFF_COUNTS.search(head)
            return int(counts[1]) if counts else 0
        if suffix == ".dae":
            return _collada_faces(path)
        if suffix == ".3mf":
            return _three_mf_faces(path)
        return _gltf_faces(path, head) if suffix in (".gltf", ".glb") else 0
    except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError, BadZipFile):
        return 0  # reading says what is wrong


def _blocks(path: Path) -> Iterator[bytes]:
    """Yield a file in parts; a line's start is in one part with what is before it."""
    with open_regular(path) as file:
        before = b"\n"
        while block := file.read(_CHUNK_BYTES):
            yield before + block
            before = block[-2:] if block[-2:-1] == b"\n" else block[-1:]


def _collada_faces(path: Path) -> int:
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return sum(int(count) for count in _COLLADA_COUNT.findall(data))


def _three_mf_faces(path: Path) -> int:
    """Count the triangles of all models, each once; 0 for an archive that is too large to be read."""
    start, count = b"<triangle ", 0
    with ZipFile(path) as archive:
        models = [entry for entry in archive.infolist() if entry.filename.lower().endswith(".model")]
        if sum(entry.file_size for entry in models) > LARGEST_FILE_BYTES:
            return 0
        for entry in models:
            before = b""
            with archive.open(entry) as part:
                while block := part.read(_CHUNK_BYTES):
                    count += (before + block).count(start)
                    before = (before + block)[1 - len(start) :]
    return count


def _gltf_faces(path: Path, head: bytes) -> int:
    """Sum the triangles of all primitives, each mesh once."""
    start, size = 0, path.stat().st_size
    if path.suffix.lower() == ".glb":
        start, size = 20, int.from_bytes(head[12:16], "little")
    if size > _LARGEST_JSON_BYTES:
        return 0
    with open_regular(path) as file:
        file.seek(start)
        header = json.loads(file.read(size).decode("utf-8-sig"))
    accessors = header["accessors"]
    primitives = [primitive for mesh in header["meshes"] for primitive in mesh["primitives"]]
    return sum(
        int(accessors[primitive.get("indices", primitive["attributes"]["POSITION"])]["count"]) // 3
        for primitive in primitives
        if primitive.get("mode", 4) == 4
    )
