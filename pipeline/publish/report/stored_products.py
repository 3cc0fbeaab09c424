"""The products of one object that its page shows: read where they are there, told apart by what they hold."""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.provenance import canonical_json
from objectfolder.tensor_file import read_metadata, read_tensor_file
from pipeline.publish.report.archive import Archive, content_digest
from pipeline.publish.viewer.digest import file_digest

TRUTHS = ("objects", "views", "modes", "touches")
ARCHIVES = (*TRUTHS, "fidelity")
TENSORS = ("encoded", "object_files")
# What a product that is whole, but not what a stage writes, makes its readers raise.
ODD = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError)


@dataclass(frozen=True)
class Shelf:
    """Where the products of a data set lie: ``FOLDER/STAGE/ID.SUFFIX``."""

    folder: Path

    def archive(self, stage: str, object_id: str) -> Path:
        """Return the path of a ground truth or of a fidelity product."""
        return self.folder / stage / f"{object_id}.zarr.zip"

    def tensors(self, stage: str, object_id: str) -> Path:
        """Return the path of an encoding or of an Object File."""
        return self.folder / stage / f"{object_id}.safetensors"

    def digests(self, object_id: str) -> dict[str, str]:
        """Return what each product holds as a hash; a product that is absent or unreadable says so."""
        found = {}
        for stage in ARCHIVES:
            found[stage] = _digest(content_digest, self.archive(stage, object_id))
        # Of an encoding a page shows what it says of itself. The digest that a file states is not asked:
        # damage does not change it, and a stranger may state any.
        found["encoded"] = _digest(_metadata_digest, self.tensors("encoded", object_id))
        found["object_files"] = _digest(file_digest, self.tensors("object_files", object_id))
        return found


@dataclass
class OpenProducts:
    """The products of one object, open; close them by ``with``.

    Parameters
    ----------
    shelf, object_id
        Whose.
    unreadable
        What could not be read, one finding a product.
    """

    shelf: Shelf
    object_id: str
    unreadable: list[str] = field(default_factory=list)
    _open: dict[str, Archive] = field(default_factory=dict)
    _stack: ExitStack = field(default_factory=ExitStack)

    def __enter__(self) -> "OpenProducts":
        for stage in ARCHIVES:
            try:
                self._open[stage] = self._stack.enter_context(
                    Archive(self.shelf.archive(stage, self.object_id))
                )
            except FileNotFoundError:
                continue
            except FormatError as error:
                self.unreadable.append(f"{stage}: {error.finding}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def get(self, stage: str) -> Archive | None:
        """Return an archive, None where there is none."""
        return self._open.get(stage)

    def attributes(self, stage: str) -> dict[str, Any]:
        """Return what a product says of itself, nothing where it cannot be read."""
        if stage in TENSORS:
            path = self.shelf.tensors(stage, self.object_id)
            try:
                return dict(read_metadata(path))
            except FileNotFoundError:
                return {}
            except FormatError as error:
                self.unreadable.append(f"{stage}: {error.finding}")
                return {}
        archive = self._open.get(stage)
        try:
            return archive.attributes() if archive else {}
        except FormatError as error:
            self.unreadable.append(f"{stage}: {error.finding}")
            return {}

    @contextmanager
    def reading(self, what: str) -> Iterator[None]:
        """Leave out what cannot be read, and note why; `what` names it where the error does not."""
        try:
            yield
        except FormatError as error:
            self.unreadable.append(f"{error.where.rpartition('/')[2]}: {error.finding}")
        except ODD as error:
            self.unreadable.append(f"{what}: not what a report can show ({type(error).__name__}: {error})")

    def object_file_tensors(self) -> dict[str, np.ndarray]:
        """Return the arrays of the Object File; none where it is absent or unreadable."""
        try:
            return dict(read_tensor_file(self.shelf.tensors("object_files", self.object_id)).tensors)
        except FileNotFoundError:
            return {}
        except FormatError as error:
            self.unreadable.append(f"object_files: {error.finding}")
            return {}


def _digest(read: Callable[[Path], str], path: Path) -> str:
    try:
        return read(path)
    except FileNotFoundError:
        return "absent"
    except FormatError as error:
        return f"unreadable: {error}"


def _metadata_digest(path: Path) -> str:
    return hashlib.sha256(canonical_json(read_metadata(path)).encode()).hexdigest()
