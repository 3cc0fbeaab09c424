"""Safetensors files: named arrays and JSON metadata, reproducible bytes, read strictly with numpy alone.

The layout is that of https://github.com/huggingface/safetensors: eight bytes of header length, a JSON
header, the arrays end to end. Metadata values that are not strings are stored as JSON text. A
``content_digest`` (SHA-256 of everything else) makes a damaged file tell itself.
"""

import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.atomic import write_whole
from objectfolder.products.canonical import canonical_json
from objectfolder.products.regular_file import open_regular

DTYPES: dict[str, np.dtype[Any]] = {
    "F64": np.dtype("<f8"),
    "F32": np.dtype("<f4"),
    "F16": np.dtype("<f2"),
    "I64": np.dtype("<i8"),
    "I32": np.dtype("<i4"),
    "I16": np.dtype("<i2"),
    "I8": np.dtype("i1"),
    "U64": np.dtype("<u8"),
    "U32": np.dtype("<u4"),
    "U16": np.dtype("<u2"),
    "U8": np.dtype("u1"),
    "BOOL": np.dtype("?"),
}
DTYPE_NAMES = {dtype: name for name, dtype in DTYPES.items()}
LARGEST_HEADER = 100_000_000  # bytes, the limit of the format
DIGEST = "content_digest"
MOST_AXES, LARGEST_NUMBER = 8, 1 << 62
REMEDY = "Make it again, or fetch it again from where it came."


@dataclass(frozen=True)
class TensorFile:
    """Named arrays and metadata; a metadata value is a string or anything that JSON holds."""

    tensors: Mapping[str, np.ndarray]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def with_metadata(self, **more: Any) -> "TensorFile":
        """Return the same arrays with metadata added or replaced."""
        return TensorFile(self.tensors, {**self.metadata, **more})


def write_tensor_file(path: Path | str, content: TensorFile) -> None:
    """Write `content` to `path`, atomically and reproducibly.

    Raises
    ------
    ValueError
        An array of a type that the format does not know, or metadata that JSON does not.
    """
    write_whole(path, to_bytes(content))


def to_bytes(content: TensorFile) -> bytes:
    """Return the bytes of a file that holds `content`; equal contents give equal bytes."""
    metadata = {
        key: value if isinstance(value, str) else canonical_json(value)
        for key, value in content.metadata.items()
    }
    header: dict[str, Any] = {}
    blocks = []
    offset = 0
    arrays = {name: np.asarray(array) for name, array in content.tensors.items()}
    # Widest types first keeps every array aligned, as the format asks.
    for name in sorted(arrays, key=lambda name: (-arrays[name].dtype.itemsize, name)):
        dtype = arrays[name].dtype.newbyteorder("<")
        if dtype not in DTYPE_NAMES:
            raise ValueError(f"{name}: safetensors has no type for {arrays[name].dtype}")
        block = np.ascontiguousarray(arrays[name], dtype=dtype).tobytes()
        header[name] = {
            "dtype": DTYPE_NAMES[dtype],
            "shape": list(arrays[name].shape),
            "data_offsets": [offset, offset + len(block)],
        }
        offset += len(block)
        blocks.append(block)
    data = b"".join(blocks)
    metadata[DIGEST] = _digest(header, metadata, data)
    text = json.dumps(
        {"__metadata__": dict(sorted(metadata.items())), **header}, separators=(",", ":")
    ).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + data


def read_metadata(path: Path | str) -> dict[str, str]:
    """Read only the metadata of a file, as the strings stored.

    Raises
    ------
    FormatError
        A truncated or foreign file.
    """
    with open_regular(path) as file:
        return metadata_of(str(path), file)


def metadata_of(where: str, file: BinaryIO) -> dict[str, str]:
    """Read only the metadata of an open file, called `where` in errors (see `read_metadata`)."""
    header, length = _read_header(where, file)
    return _checked_metadata(where, header, file.seek(0, os.SEEK_END) - length)


def read_tensor_file(path: Path | str) -> TensorFile:
    """Read a whole file; metadata values are the strings stored.

    Raises
    ------
    FormatError
        A truncated, foreign or damaged file.
    """
    where = str(path)
    with open_regular(path) as file:
        header, _ = _read_header(where, file)
        data = file.read()
    metadata = _checked_metadata(where, header, len(data))
    entries = {name: entry for name, entry in header.items() if name != "__metadata__"}
    if DIGEST in metadata and metadata[DIGEST] != _digest(entries, metadata, data):
        raise FormatError(where, "its content does not match its digest", REMEDY)
    tensors = {}
    for name, entry in entries.items():
        begin, end = entry["data_offsets"]
        try:
            tensors[name] = np.frombuffer(data[begin:end], DTYPES[entry["dtype"]]).reshape(entry["shape"])
        except ValueError as error:
            raise FormatError(where, f"array {name}: {error}", REMEDY) from error
    return TensorFile(tensors, metadata)


def _read_header(where: str, file: BinaryIO) -> tuple[dict[str, Any], int]:
    """Return the header and the number of bytes before the data."""
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    length = int.from_bytes(file.read(8), "little")
    if size < 8 or length > min(LARGEST_HEADER, size - 8):
        raise FormatError(where, f"not a safetensors file, or truncated ({size} bytes)", REMEDY)
    try:
        header = json.loads(file.read(length))
    except (ValueError, RecursionError) as error:
        raise FormatError(where, f"its header is not JSON ({error})", REMEDY) from error
    if not isinstance(header, dict):
        raise FormatError(where, "its header is no JSON object", REMEDY)
    return header, 8 + length


def _checked_metadata(where: str, header: Mapping[str, Any], data_size: int) -> dict[str, str]:
    """Return the metadata after checking that the arrays fill the data exactly."""
    metadata = header.get("__metadata__", {})
    if not isinstance(metadata, dict) or not all(isinstance(value, str) for value in metadata.values()):
        raise FormatError(where, "its metadata is not of strings", REMEDY)
    spans = []
    for name, entry in header.items():
        if name == "__metadata__":
            continue
        try:
            (begin, end), shape = entry["data_offsets"], entry["shape"]
            # Types, not instances: true and false are integers to Python, and no sizes to numpy.
            if len(shape) > MOST_AXES or not all(
                type(number) is int and 0 <= number < LARGEST_NUMBER for number in (begin, end, *shape)
            ):
                raise ValueError("no shape or place")
            expected = math.prod(shape) * DTYPES[entry["dtype"]].itemsize
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError(where, f"array {name} is not described ({error!r})", REMEDY) from error
        if end - begin != expected:
            raise FormatError(where, f"array {name} of {expected} bytes lies at {begin}..{end}", REMEDY)
        spans.append((begin, end))
    position = 0
    for begin, end in sorted(spans):
        if begin != position:
            raise FormatError(where, f"arrays overlap or leave a gap at byte {position}", REMEDY)
        position = end
    if position != data_size:
        raise FormatError(where, f"{data_size} bytes of arrays where {position} are described", REMEDY)
    return dict(metadata)


def _digest(entries: Mapping[str, Any], metadata: Mapping[str, str], data: bytes) -> str:
    described = canonical_json([entries, {key: value for key, value in metadata.items() if key != DIGEST}])
    return hashlib.sha256(described.encode() + data).hexdigest()
