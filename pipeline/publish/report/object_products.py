"""The products of one object that its page shows."""

import contextlib
import hashlib
import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from types import EllipsisType
from typing import Any

import numpy as np
import zarr
from zarr.buffer.cpu import Buffer
from zarr.storage import MemoryStore

from objectfolder.errors import FormatError
from objectfolder.products.provenance import canonical_json, file_digest
from objectfolder.products.store import Array, Product
from objectfolder.products.tensor_file import read_metadata
from pipeline.dataset.archives import END, REMEDY, UNREADABLE, read_entries
from pipeline.dataset.products import read_description
from pipeline.dataset.stages import ENCODED, OBJECT_FILES, STAGES

SUFFIXES = {kind.name: kind.suffix for stage in STAGES.values() for kind in stage.products}
# What a product that is whole, but not what a stage writes, makes its readers raise.
UNEXPECTED = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError)


class ObjectProducts:
    """The products of one object, each checked before it is read.

    Parameters
    ----------
    data
        Folder of the stages' folders.
    name
        Of the object's files, without a suffix.

    Attributes
    ----------
    unreadable
        What could not be read, one finding a product.
    """

    def __init__(self, data: Path, name: str) -> None:
        self._data, self._name = data, name
        self.unreadable: list[str] = []

    def path(self, kind: str) -> Path:
        """Return the path of a product."""
        return self._data / kind / f"{self._name}{SUFFIXES[kind]}"

    def digests(self) -> dict[str, str]:
        """Return what each product holds as a hash; a product that is absent or unreadable says so."""
        found = {kind: _digest(_directory_digest, self.path(kind)) for kind in SUFFIXES}
        # Of an encoding a page shows what it says of itself. The digest that a file states is not asked:
        # damage does not change it, and a file from elsewhere may state any.
        found[ENCODED.name] = _digest(_metadata_digest, self.path(ENCODED.name))
        found[OBJECT_FILES.name] = _digest(file_digest, self.path(OBJECT_FILES.name))
        return found

    def arrays(self, kind: str, *names: str, rows: slice | EllipsisType = ...) -> Product:
        """Return an archive with `rows` of these arrays of it, or of all where none is named.

        Nothing else of the archive is read.

        Raises
        ------
        FileNotFoundError
            No such product.
        FormatError
            It is damaged, is not what a stage writes, or lacks an array.
        """
        path = self.path(kind)
        path.stat()
        entries = dict(read_entries(path, names or None))
        there = [name.partition("/")[0] for name in entries if name.endswith("/zarr.json")]
        if missing := set(names).difference(there):
            raise FormatError(str(path), f"no array {sorted(missing)}", REMEDY)
        store = MemoryStore({name: Buffer.from_bytes(content) for name, content in entries.items()})
        try:
            group = zarr.open_group(store, mode="r", zarr_format=3)
            return Product({name: _read(group, name, rows) for name in there}, dict(group.attrs))
        except UNREADABLE as error:
            raise FormatError(str(path), f"damaged product ({error})", REMEDY) from error

    def attributes(self, kind: str) -> dict[str, Any]:
        """Return the attributes of a product, empty where it cannot be read."""
        with self.reading(kind):
            return read_description(self.path(kind))
        return {}

    @contextlib.contextmanager
    def reading(self, what: str) -> Iterator[None]:
        """Leave out what is absent or cannot be read, and note why it cannot be; `what` names it then."""
        try:
            yield
        except FileNotFoundError:
            pass
        except FormatError as error:
            self.unreadable.append(f"{'/'.join(Path(error.where).parts[-2:])}: {error.finding}")
        except UNEXPECTED as error:
            self.unreadable.append(f"{what}: not what a report can show ({type(error).__name__}: {error})")


def _read(group: zarr.Group, name: str, rows: slice | EllipsisType) -> Array:
    stored = group[name]
    assert isinstance(stored, zarr.Array)
    dims = tuple(f"axis_{axis}" for axis in range(stored.ndim))  # a page asks for none
    return Array(np.asarray(stored[rows]), dims, str(stored.attrs["units"]), str(stored.attrs["long_name"]))


def _digest(read: Callable[[Path], str], path: Path) -> str:
    try:
        return read(path)
    except FileNotFoundError:
        return "absent"
    except (FormatError, OSError, struct.error) as error:
        return f"unreadable: {error}"


def _directory_digest(path: Path) -> str:
    """Return a hash of the directory of an archive, which has the checksum of every entry."""
    with path.open("rb") as file:
        file.seek(-END.size, os.SEEK_END)
        *_, size, start, _ = END.unpack(file.read())
        file.seek(start)
        return hashlib.sha256(file.read(size)).hexdigest()


def _metadata_digest(path: Path) -> str:
    return hashlib.sha256(canonical_json(read_metadata(path)).encode()).hexdigest()
