"""Checks of a product's archive: it may hold exactly what `objectfolder.products.store.write_product` writes.

An archive fetched from elsewhere is not trusted. Zarr's own reader would follow any codec, type and
size that it declares; this looks at the declarations first, and decodes no array.
"""

import contextlib
import math
import re
import struct
import zipfile
import zlib
from collections.abc import Container, Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic_core import from_json

from objectfolder.errors import FormatError
from objectfolder.products.regular_file import open_regular

REMEDY = "Delete it; a run makes it again."
GROUP = "zarr.json"
LARGEST_JSON_BYTES = 64_000_000
LARGEST_PRODUCT_BYTES = 8_000_000_000  # of all arrays together, as they are in memory
MOST_CHUNKS = 1_000_000
UNREADABLE = (
    zipfile.BadZipFile, struct.error, zlib.error, OSError, EOFError, LookupError, TypeError, ValueError,
    RuntimeError, AttributeError,
)  # fmt: skip
ITEM_BYTES = {
    "bool": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "float16": 2, "int32": 4, "uint32": 4,
    "float32": 4, "complex64": 8, "int64": 8, "uint64": 8, "float64": 8, "complex128": 16,
}  # fmt: skip
CODECS = ("bytes", "blosc")
# Four of versions, flags and size of an item, then bytes before and after compression, and of a block.
BLOSC_HEADER_BYTES = 16
END = struct.Struct("<4s4H2LH")  # the last record of an archive without a comment
NO_NUMBERS = ("NaN", "Infinity", "-Infinity")  # as Zarr writes them
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
_CHUNK = re.compile(r"c(/\d{1,9}){0,32}")


def read_attributes(path: Path) -> dict[str, Any]:
    """Read the attributes of a product and nothing else of it.

    Raises
    ------
    FormatError
        A file that is no product, or one whose header would not fit its limits.
    FileNotFoundError
        No such file.
    """
    path.stat()
    with errors_of(path), open_regular(path) as file, zipfile.ZipFile(file) as archive:
        return describe(archive, ())[0]


def check(path: Path) -> None:
    """Check every entry of a product's archive and its checksum; raise FormatError for unexpected content."""
    with errors_of(path), open_regular(path) as file, zipfile.ZipFile(file) as archive:
        _, arrays = describe(archive)
        for name in archive.namelist():
            if not name.endswith("zarr.json"):
                read_chunk(archive, name, arrays)


@contextlib.contextmanager
def errors_of(path: Path) -> Iterator[None]:
    """Raise FormatError for whatever the readers of a damaged or hostile archive raise."""
    try:
        yield
    except UNREADABLE as error:
        raise FormatError(str(path), f"unreadable ({error})", REMEDY) from error


def describe(
    archive: zipfile.ZipFile, selection: Container[str] | None = None
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Return the checked attributes of a product and the metadata of its arrays, or of those in `selection`.

    A damaged one makes this raise any of `UNREADABLE`; so does a name that leads out of it, or a type, codec
    or size that no product has.
    """
    names = archive.namelist()
    if len(set(names)) != len(names):
        raise ValueError("an entry occurs twice")
    if GROUP not in names:
        raise ValueError("it has no group of Zarr 3")
    attributes = attributes_of(_json_text(archive, archive.getinfo(GROUP)))
    arrays: dict[str, dict[str, Any]] = {}
    for entry in archive.infolist():
        name, _, rest = entry.filename.partition("/")
        if entry.filename == GROUP or (selection is not None and name not in selection):
            continue
        if not rest or not _NAME.fullmatch(name):
            raise ValueError(f"entry {entry.filename!r} is no part of a product")
        if rest == GROUP:
            arrays[name] = from_json(_json_text(archive, entry))
    total = sum(described_bytes(name, description)[1] for name, description in arrays.items())
    if total > LARGEST_PRODUCT_BYTES:
        raise ValueError(f"its arrays would take {total} bytes")
    return attributes, arrays


def _json_text(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    if entry.compress_type != zipfile.ZIP_STORED or entry.file_size > LARGEST_JSON_BYTES:
        raise ValueError(f"entry {entry.filename} is compressed or of {entry.file_size} bytes")
    return archive.read(entry)


def attributes_of(text: bytes) -> dict[str, Any]:
    """Return the attributes that a group's JSON holds; raises ValueError or TypeError for any other JSON."""
    metadata = from_json(text)
    if {**metadata, "attributes": {}} != {"zarr_format": 3, "node_type": "group", "attributes": {}}:
        raise ValueError(f"not a group of Zarr 3, or one with further keys: {sorted(metadata)}")
    if not isinstance(metadata["attributes"], dict):
        raise TypeError("its attributes have no names")
    return metadata["attributes"]


def described_bytes(name: str, description: dict[str, Any]) -> tuple[int, int]:
    """Return the bytes of a chunk and of the array in memory.

    Raises
    ------
    LookupError, TypeError, ValueError
        The description is not that of an array of a product.
    """
    shape, grid = description["shape"], description["chunk_grid"]
    chunks = grid["configuration"]["chunk_shape"]
    codecs = [codec["name"] for codec in description["codecs"]]
    if description["zarr_format"] != 3 or description["node_type"] != "array" or grid["name"] != "regular":
        raise ValueError(f"{name} is no array of Zarr 3 in regular chunks")
    if description["data_type"] not in ITEM_BYTES:
        raise ValueError(f"{name} is of type {description['data_type']!r}")
    if tuple(codecs) != CODECS or description.get("storage_transformers"):
        raise ValueError(f"{name} is stored by {codecs}")
    fill = description["fill_value"]
    if isinstance(fill, str) and fill not in NO_NUMBERS:
        raise ValueError(f"{name} is filled with {fill[:20]!r}")
    if len(chunks) != len(shape) or not all(type(size) is int and size >= 0 for size in (*shape, *chunks)):
        raise ValueError(f"{name} has shape {shape} in chunks of {chunks}")
    item = ITEM_BYTES[description["data_type"]]
    count = math.prod(math.ceil(size / max(1, chunk)) for size, chunk in zip(shape, chunks, strict=True))
    if count > MOST_CHUNKS:
        raise ValueError(f"{name} lies in {count} chunks")
    chunk = math.prod(chunks) * item
    return chunk, max(math.prod(shape) * item, chunk)


def read_chunk(archive: zipfile.ZipFile, name: str, arrays: Mapping[str, dict[str, Any]]) -> bytes:
    """Return an entry that is a chunk of one of these arrays, compressed; raises as `describe` does."""
    array, _, rest = name.partition("/")
    if array not in arrays or not _CHUNK.fullmatch(rest):
        raise ValueError(f"entry {name!r} is no part of a product")
    if archive.getinfo(name).compress_type != zipfile.ZIP_STORED:
        raise ValueError(f"entry {name} is compressed twice")
    content, (byte_count, _) = archive.read(name), described_bytes(array, arrays[array])
    length = int.from_bytes(content[4:8], "little")
    if len(content) < BLOSC_HEADER_BYTES or length != byte_count:
        raise ValueError(f"entry {name} holds {length} bytes where {byte_count} are described")
    return content
