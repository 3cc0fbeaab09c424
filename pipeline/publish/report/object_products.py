"""The products of one object that its page shows."""

import contextlib
import hashlib
import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.provenance import canonical_json, file_digest
from objectfolder.products.store import Product, read_product
from objectfolder.products.tensor_file import read_metadata, read_tensor_file
from pipeline.dataset.archives import END, check, read_attributes
from pipeline.dataset.products import ZARR
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
        self._checked: set[str] = set()
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

    def arrays(self, kind: str, *names: str) -> Product:
        """Return an archive with these arrays of it, or with all where none is named.

        Raises
        ------
        FileNotFoundError
            No such product.
        FormatError
            It is damaged, is not what a stage writes, or lacks an array.
        """
        return read_product(self._sound(kind), names or None)

    def attributes(self, kind: str) -> dict[str, Any]:
        """Return the attributes of a product, empty where it cannot be read."""
        with self.reading(kind):
            if SUFFIXES[kind] == ZARR:
                return read_attributes(self._sound(kind))
            return dict(read_metadata(self.path(kind)))
        return {}

    def object_file_tensors(self) -> dict[str, np.ndarray]:
        """Return the arrays of the Object File; none where it is absent or unreadable."""
        with self.reading(OBJECT_FILES.name):
            return dict(read_tensor_file(self.path(OBJECT_FILES.name)).tensors)
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

    def _sound(self, kind: str) -> Path:
        """Return the path of an archive after checking it once."""
        path = self.path(kind)
        if kind not in self._checked:
            path.stat()
            check(path)
            self._checked.add(kind)
        return path


def _digest(read: Callable[[Path], str], path: Path) -> str:
    try:
        return read(path)
    except FileNotFoundError:
        return "absent"
    except (FormatError, OSError, struct.error) as error:
        return f"unreadable: {error}"


def _directory_digest(path: Path) -> str:
    """Return a hash of the directory of an archive, with the checksum of every entry.

    A thousand archives take a fifth of a second.
    """
    with path.open("rb") as file:
        file.seek(-END.size, os.SEEK_END)
        *_, size, start, _ = END.unpack(file.read())
        file.seek(start)
        return hashlib.sha256(file.read(size)).hexdigest()


def _metadata_digest(path: Path) -> str:
    return hashlib.sha256(canonical_json(read_metadata(path)).encode()).hexdigest()
