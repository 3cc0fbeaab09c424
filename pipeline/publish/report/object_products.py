"""The products of one object that its page shows."""

import contextlib
import hashlib
import os
import struct
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numcodecs import Blosc

from objectfolder.errors import FormatError
from objectfolder.products.provenance import canonical_json, file_digest
from objectfolder.products.regular_file import open_regular, require_regular
from objectfolder.products.store import Array, Product
from objectfolder.products.tensor_file import read_metadata
from pipeline.dataset.archives import END, describe, errors_of, read_chunk
from pipeline.dataset.products import ZARR, read_description
from pipeline.dataset.stages import ENCODED, OBJECT_FILES, STAGES
from pipeline.dataset.verified import Verified

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
    opened
        Closes the archives that were opened.
    """

    def __init__(self, data: Path, name: str) -> None:
        self._data, self._name = data, name
        self.unreadable: list[str] = []
        self.opened = contextlib.ExitStack()
        self._archives: dict[str, zipfile.ZipFile] = {}

    def path(self, kind: str) -> Path:
        """Return the path of a product."""
        return self._data / f"{kind}/{self._name}{SUFFIXES[kind]}"

    def digests(self, states: Verified) -> dict[str, str]:
        """Return what each product holds as a hash; a product that is absent or unreadable says so."""
        return {
            kind: _digest(f"{self._data}{os.sep}{kind}{os.sep}{self._name}{suffix}", DIGESTS[kind], states)
            for kind, suffix in SUFFIXES.items()  # a `Path` each would take as long
        }

    def arrays(self, kind: str, *names: str, rows: slice = slice(None)) -> Product:
        """Return an archive with `rows` of these arrays of it, or of all where none is named.

        Nothing else of the archive is read.

        Raises
        ------
        FileNotFoundError
            No such product.
        FormatError
            It is damaged, is not what a stage writes, or lacks an array.
        """
        archive = self._archive(kind)
        with errors_of(self.path(kind)):
            attributes, descriptions = describe(archive, names or None)
            if missing := set(names).difference(descriptions):
                raise ValueError(f"no array {sorted(missing)}")
            return Product(
                {name: _read(archive, name, descriptions, rows) for name in descriptions}, attributes
            )

    def attributes(self, kind: str) -> dict[str, Any]:
        """Return the attributes of a product, empty where it cannot be read."""
        with self.reading(kind):
            if SUFFIXES[kind] != ZARR:
                return read_description(self.path(kind))
            archive = self._archive(kind)
            with errors_of(self.path(kind)):
                return describe(archive, ())[0]
        return {}

    def _archive(self, kind: str) -> zipfile.ZipFile:
        """Return an archive, opened once: its directory may have thousands of entries."""
        path = self.path(kind)
        path.stat()
        if kind not in self._archives:
            with errors_of(path):
                require_regular(path)
                self._archives[kind] = self.opened.enter_context(zipfile.ZipFile(path))
        return self._archives[kind]

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


def _read(archive: zipfile.ZipFile, name: str, descriptions: dict[str, dict[str, Any]], rows: slice) -> Array:
    """Decode rows of an array, whose chunks hold whole rows, as stages write them.

    Zarr's own reader takes ten times as long: it hands each chunk to another thread.
    """
    array_entry, attributes = descriptions[name], descriptions[name]["attributes"]
    shape, chunk = array_entry["shape"], array_entry["chunk_grid"]["configuration"]["chunk_shape"]
    if not shape or chunk[1:] != [max(1, size) for size in shape[1:]]:
        raise ValueError(f"{name} does not lie row by row")
    kind, rows_asked = np.dtype(array_entry["data_type"]), range(*rows.indices(shape[0]))
    first, last = rows_asked.start // chunk[0], -(-rows_asked.stop // chunk[0])
    blocks = [np.zeros((0, *chunk[1:]), kind)]
    for index in range(first, last):
        entry = f"{name}/c/{index}" + "/0" * (len(shape) - 1)
        if entry in archive.NameToInfo:
            content = Blosc().decode(read_chunk(archive, entry, descriptions))
            blocks.append(np.frombuffer(content, kind).reshape(chunk))
        else:
            blocks.append(np.full(chunk, array_entry["fill_value"], kind))
    begin = rows_asked.start - first * chunk[0]
    values = np.concatenate(blocks)[begin : begin + len(rows_asked), *map(slice, shape[1:])]
    dims = tuple(f"axis_{axis}" for axis in range(len(shape)))  # a page asks for none
    return Array(values, dims, str(attributes["units"]), str(attributes["long_name"]))


def _digest(path: str, read: Callable[[Path | str], str], states: Verified) -> str:
    try:
        return states.source_digest(path, read)
    except FileNotFoundError:
        return "absent"
    except (FormatError, OSError, struct.error) as error:
        return f"unreadable: {error}"


def _directory_digest(path: Path | str) -> str:
    """Return a hash of the directory of an archive, which has the checksum of every entry."""
    with open_regular(path) as file:
        file.seek(-END.size, os.SEEK_END)
        *_, size, start, _ = END.unpack(file.read())
        file.seek(start)
        return hashlib.sha256(file.read(size)).hexdigest()


def _metadata_digest(path: Path | str) -> str:
    return hashlib.sha256(canonical_json(read_metadata(path)).encode()).hexdigest()


# Of an encoding a page shows what it says of itself. The digest that a file states is not asked: damage does
# not change it, and a file from elsewhere may state any.
DIGESTS = dict.fromkeys(SUFFIXES, _directory_digest) | {
    ENCODED.name: _metadata_digest,
    OBJECT_FILES.name: file_digest,
}
