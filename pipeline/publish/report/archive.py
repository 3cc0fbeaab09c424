"""Products read chunk by chunk, without opening Zarr: a report reads a few items of thousands of archives.

Zarr's own reader takes some twenty milliseconds for what is read here in two. What is read is exactly what
`objectfolder.store.write_product` writes; anything else is refused.
"""

import hashlib
import math
import os
import struct
import zipfile
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numcodecs.blosc import decompress

from objectfolder.errors import FormatError
from pipeline.dataset.archives import (
    BLOSC_HEADER_BYTES,
    END,
    END_MARK,
    LARGEST_PRODUCT_BYTES,
    REMEDY,
    described_bytes,
    read_json,
)

DAMAGE = (
    zipfile.BadZipFile, struct.error, OSError, EOFError, LookupError, TypeError, ValueError, RuntimeError,
)  # fmt: skip
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
    with path.open("rb") as file:
        try:
            file.seek(-END.size, os.SEEK_END)
            mark, *_, size, start, comment = END.unpack(file.read())
            file.seek(start)
            directory = file.read(size)
        except (OSError, struct.error) as error:
            raise _damaged(path, error) from error
    if mark != END_MARK or comment or len(directory) != size:
        raise _damaged(path, "its directory is not where a product's is")
    return hashlib.sha256(directory).hexdigest()


class Archive:
    """One product, open for reading.

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
        try:
            self._zip = zipfile.ZipFile(path)
        except FileNotFoundError:
            raise
        except DAMAGE as error:
            raise _damaged(path, error) from error
        self._form = cache(self._read_form)

    def __enter__(self) -> "Archive":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._zip.close()

    def __contains__(self, name: str) -> bool:
        return f"{name}/zarr.json" in self._zip.NameToInfo

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
            raise _damaged(self.path, error) from error
        if not isinstance(attributes, dict):
            raise _damaged(self.path, "its attributes have no names")
        return attributes

    def array(self, name: str) -> np.ndarray:
        """Return a whole array, stored in one chunk or in a chunk for each item.

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
            raise _damaged(self.path, error) from error

    def item_sums(self, name: str) -> list[tuple[int, int] | None]:
        """Return size and checksum of each item as it is stored, by which equal items are known.

        None for an item that does not lie in a chunk of its own, or is not stored because it is all zeros.

        Raises
        ------
        FormatError
            As for `array`.
        """
        try:
            shape, chunk, _ = self._form(name)
            if chunk[0] != 1:
                return [None] * shape[0]
            entries = [self._zip.NameToInfo.get(_entry(name, item, len(shape))) for item in range(shape[0])]
            return [None if entry is None else (entry.file_size, entry.CRC) for entry in entries]
        except DAMAGE as error:
            raise _damaged(self.path, error) from error

    def _read_form(self, name: str) -> tuple[tuple[int, ...], tuple[int, ...], np.dtype[Any]]:
        """Return shape, shape of a chunk, and type of an array, after checking its declarations."""
        said = self._json(f"{name}/zarr.json")
        chunk_bytes, whole_bytes = described_bytes(name, said)
        shape, chunk = tuple(said["shape"]), tuple(said["chunk_grid"]["configuration"]["chunk_shape"])
        stored = tuple(max(1, size) for size in shape)
        if chunk not in (stored, (1, *stored[1:])):
            raise ValueError(f"{name} has shape {shape} in chunks of {chunk}")
        # A chunk that is all zeros is not stored: a few bytes may declare any number of them.
        if chunk_bytes > LARGEST_CHUNK_BYTES or whole_bytes > LARGEST_PRODUCT_BYTES:
            raise ValueError(f"{name} has shape {shape} in chunks of {chunk}, which is too large")
        return shape, chunk, np.dtype(said["data_type"])

    def _chunk(self, name: str, item: int, shape: tuple[int, ...], dtype: np.dtype[Any]) -> np.ndarray:
        entry = _entry(name, item, len(shape))
        stored = self._zip.NameToInfo.get(entry)
        if stored is None:
            return np.zeros(shape, dtype)  # Zarr writes no chunk that is all zeros
        if stored.compress_type != zipfile.ZIP_STORED:
            raise ValueError(f"entry {entry} is compressed twice")
        content = self._zip.read(stored)
        expected = math.prod(shape) * dtype.itemsize
        if len(content) < BLOSC_HEADER_BYTES or int.from_bytes(content[4:8], "little") != expected:
            raise ValueError(f"entry {entry} does not hold {expected} bytes")
        return np.frombuffer(decompress(content), dtype).reshape(shape)

    def _json(self, entry: str) -> Any:
        return read_json(self._zip, self._zip.getinfo(entry))


def _entry(name: str, item: int, axes: int) -> str:
    """Return the name of the entry that holds a chunk."""
    return "/".join([name, "c", *([str(item), *["0"] * (axes - 1)] if axes else [])])


def _damaged(path: Path, error: object) -> FormatError:
    return FormatError(str(path), f"not a readable product ({error})", REMEDY)
