"""Products read chunk by chunk, without opening Zarr: a report reads a few items of thousands of archives.

Zarr's own reader takes some twenty milliseconds for what is read here in two. What is read is exactly what
`objectfolder.store.write_product` writes; anything else is refused.
"""

import hashlib
import json
import math
import os
import re
import struct
import zipfile
import zlib
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numcodecs.blosc import decompress

from objectfolder.errors import FormatError
from pipeline.dataset.archives import (
    BLOSC_HEADER_BYTES,
    CENTRAL,
    CENTRAL_MARK,
    CODECS,
    END,
    END_MARK,
    ITEM_BYTES,
    LARGEST_JSON_BYTES,
    LARGEST_PRODUCT_BYTES,
    LOCAL,
    LOCAL_MARK,
    MOST_CHUNKS,
    REMEDY,
)

DAMAGE = (struct.error, OSError, LookupError, TypeError, ValueError, RuntimeError)
# No picture, sound or mesh of one item is larger; what declares more is not decompressed.
LARGEST_CHUNK_BYTES = 1_000_000_000


def content_digest(path: Path) -> str:
    """Return a hash of what a product holds: the directory of its archive, with every entry's checksum.

    Nothing is decompressed: a thousand products take a fifth of a second.

    Raises
    ------
    FileNotFoundError
        No such file.
    FormatError
        No archive.
    """
    with Archive(path) as archive:
        return hashlib.sha256(archive.directory).hexdigest()


class _Entry(NamedTuple):
    """Bytes, CRC-32 and where its local header begins."""

    size: int
    checksum: int
    start: int


class Archive:
    """One product, open for reading.

    Entries are found in the bytes of the archive's directory when they are asked for: a product has
    hundreds, of which a report reads a few.

    Parameters
    ----------
    path
        A ``.zarr.zip``.

    Raises
    ------
    FileNotFoundError
        No such file.
    FormatError
        No archive.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = path.open("rb")
        try:
            self.directory = self._directory()
        except DAMAGE as error:
            self._file.close()
            raise self._damaged(error) from error
        self._declared: dict[str, dict[str, Any]] = {}

    def __enter__(self) -> "Archive":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def __contains__(self, name: str) -> bool:
        return self._find(f"{name}/zarr.json") is not None

    def attributes(self) -> dict[str, Any]:
        """Return the product's attributes.

        Raises
        ------
        FormatError
            It has none that can be read.
        """
        try:
            attributes = self._json("zarr.json")["attributes"]
        except DAMAGE as error:
            raise self._damaged(error) from error
        if not isinstance(attributes, dict):
            raise self._damaged("its attributes have no names")
        return attributes

    def array(self, name: str) -> np.ndarray:
        """Return a whole array, whether it lies in one chunk or in one an item.

        Raises
        ------
        FormatError
            An array that is absent or damaged.
        """
        try:
            shape, chunk, dtype = self._form(name)
            if math.prod(shape) == 0:
                return np.zeros(shape, dtype)
            if chunk[0:1] == shape[0:1] or not shape:
                return self._chunk(name, 0, shape, dtype)
            return np.concatenate([self._chunk(name, item, chunk, dtype) for item in range(shape[0])])
        except DAMAGE as error:
            raise self._damaged(error) from error

    def item(self, name: str, index: int) -> np.ndarray:
        """Return one item of the first axis of an array.

        Raises
        ------
        FormatError
            As for `array`.
        """
        try:
            shape, chunk, dtype = self._form(name)
            if not 0 <= index < shape[0]:
                raise ValueError(f"{name} has {shape[0]} items, not one at {index}")
            if chunk[0] == 1:
                return self._chunk(name, index, chunk, dtype)[0]
            return self._chunk(name, 0, shape, dtype)[index]
        except DAMAGE as error:
            raise self._damaged(error) from error

    def item_sums(self, name: str) -> list[tuple[int, int] | None]:
        """Return size and checksum of each item as it is stored, by which equal items are known.

        None for an item that does not lie in a chunk of its own, or is not stored because it is all zeros.
        """
        try:
            shape, chunk, _ = self._form(name)
            sums: list[tuple[int, int] | None] = [None] * shape[0]
            if chunk[0] != 1:
                return sums
            rest = b"/0" * (len(shape) - 1)
            for found in re.finditer(re.escape(f"{name}/c/".encode()) + rb"(\d{1,9})" + rest, self.directory):
                entry = self._entry_at(found.start(), found[0])
                if entry is not None:
                    sums[int(found[1])] = (entry.size, entry.checksum)
            return sums
        except DAMAGE as error:
            raise self._damaged(error) from error

    def _form(self, name: str) -> tuple[tuple[int, ...], tuple[int, ...], np.dtype[Any]]:
        """Return shape, shape of a chunk, and type of an array, after checking what it says of itself."""
        if name not in self._declared:
            self._declared[name] = self._json(f"{name}/zarr.json")
        said = self._declared[name]
        shape, chunk = tuple(said["shape"]), tuple(said["chunk_grid"]["configuration"]["chunk_shape"])
        stored = tuple(max(1, size) for size in shape)
        if tuple(codec["name"] for codec in said["codecs"]) != CODECS or said["data_type"] not in ITEM_BYTES:
            raise ValueError(f"{name} is stored in another way than products are")
        if chunk not in (stored, (1, *stored[1:])):
            raise ValueError(f"{name} has shape {shape} in chunks of {chunk}")
        item = ITEM_BYTES[said["data_type"]]
        if math.prod(chunk) * item > LARGEST_CHUNK_BYTES:
            raise ValueError(f"{name} has chunks of {chunk}")
        # A chunk that is all zeros is not stored: a few bytes may declare any number of them.
        if math.prod(shape) * item > LARGEST_PRODUCT_BYTES or (chunk != stored and shape[0] > MOST_CHUNKS):
            raise ValueError(f"{name} has shape {shape} in chunks of {chunk}, which is too large")
        return shape, chunk, np.dtype(said["data_type"])

    def _chunk(self, name: str, item: int, shape: tuple[int, ...], dtype: np.dtype[Any]) -> np.ndarray:
        entry = "/".join([name, "c", *([str(item)] if shape else []), *["0"] * (len(shape) - 1)])
        content = self._read(entry)
        if content is None:
            return np.zeros(shape, dtype)  # Zarr writes no chunk that is all zeros
        expected = math.prod(shape) * dtype.itemsize
        if len(content) < BLOSC_HEADER_BYTES or int.from_bytes(content[4:8], "little") != expected:
            raise ValueError(f"entry {entry} does not hold {expected} bytes")
        return np.frombuffer(decompress(content), dtype).reshape(shape)

    def _json(self, entry: str) -> Any:
        content = self._read(entry, LARGEST_JSON_BYTES)
        if content is None:
            raise KeyError(f"no entry {entry}")
        return json.loads(content)

    def _read(self, name: str, most: int = LARGEST_CHUNK_BYTES) -> bytes | None:
        """Return what an entry holds, None where there is none."""
        entry = self._find(name)
        if entry is None:
            return None
        if entry.size > most:
            raise ValueError(f"entry {name} is too large")
        self._file.seek(entry.start)
        mark, *_, name_size, more_size = LOCAL.unpack(self._file.read(LOCAL.size))
        if mark != LOCAL_MARK:
            raise ValueError(f"entry {name} is not where the directory says")
        self._file.seek(name_size + more_size, os.SEEK_CUR)
        content = self._file.read(entry.size)
        if zlib.crc32(content) != entry.checksum:
            raise ValueError(f"entry {name} is damaged")
        return content

    def _find(self, name: str) -> "_Entry | None":
        sought = name.encode()
        place = self.directory.find(sought)
        while place >= 0:
            entry = self._entry_at(place, sought)
            if entry is not None:
                return entry
            place = self.directory.find(sought, place + 1)
        return None

    def _entry_at(self, place: int, name: bytes) -> "_Entry | None":
        """Return the entry whose name stands at a place of the directory, None where another's does."""
        if place < CENTRAL.size:
            return None
        fields = CENTRAL.unpack_from(self.directory, place - CENTRAL.size)
        mark, stored, checksum, packed, size, name_size, start = (fields[i] for i in (0, 4, 7, 8, 9, 10, 16))
        if mark != CENTRAL_MARK or name_size != len(name):
            return None
        if stored != zipfile.ZIP_STORED or packed != size:
            raise ValueError(f"entry {name.decode()} is compressed")
        return _Entry(size, checksum, start)

    def _directory(self) -> bytes:
        self._file.seek(-END.size, os.SEEK_END)
        mark, *_, size, start, comment = END.unpack(self._file.read(END.size))
        if mark != END_MARK or comment or 0xFFFFFFFF in (size, start):
            raise ValueError("its directory is not where a product's is")
        self._file.seek(start)
        directory = self._file.read(size)
        if len(directory) != size:
            raise ValueError("it is cut short")
        return directory

    def _damaged(self, error: object) -> FormatError:
        return FormatError(str(self.path), f"not a readable product ({error})", REMEDY)
