"""The products of one object that its page shows."""

import contextlib
import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.provenance import canonical_json, file_digest
from objectfolder.tensor_file import read_metadata, read_tensor_file
from pipeline.dataset.products import ZARR
from pipeline.dataset.stages import STAGES
from pipeline.publish.report.archive import Archive, content_digest

ARCHIVES = tuple(kind.name for stage in STAGES.values() for kind in stage.products if kind.suffix == ZARR)
# What a product that is whole, but not what a stage writes, makes its readers raise.
UNEXPECTED = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError)


class ObjectProducts:
    """The products of one object; within ``with`` its archives are open.

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
        self._archives: dict[str, Archive] = {}
        self._stack = contextlib.ExitStack()
        self.unreadable: list[str] = []

    def path(self, stage: str) -> Path:
        """Return the path of the product of a stage."""
        return self._data / stage / f"{self._name}{'.zarr.zip' if stage in ARCHIVES else '.safetensors'}"

    def digests(self) -> dict[str, str]:
        """Return what each product holds as a hash; a product that is absent or unreadable says so."""
        found = {stage: _digest(content_digest, self.path(stage)) for stage in ARCHIVES}
        # Of an encoding a page shows what it says of itself. The digest that a file states is not asked:
        # damage does not change it, and a file from elsewhere may state any.
        found["encoded"] = _digest(_metadata_digest, self.path("encoded"))
        found["object_files"] = _digest(file_digest, self.path("object_files"))
        return found

    def __enter__(self) -> "ObjectProducts":
        for stage in ARCHIVES:
            with self.reading(stage):
                self._archives[stage] = self._stack.enter_context(Archive(self.path(stage)))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def get(self, stage: str) -> Archive | None:
        """Return an archive; None for an absent one."""
        return self._archives.get(stage)

    def attributes(self, stage: str) -> dict[str, Any]:
        """Return the attributes of a product, empty where it cannot be read."""
        with self.reading(stage):
            if stage not in ARCHIVES:
                return dict(read_metadata(self.path(stage)))
            if stage in self._archives:
                return self._archives[stage].attributes()
        return {}

    def object_file_tensors(self) -> dict[str, np.ndarray]:
        """Return the arrays of the Object File; none where it is absent or unreadable."""
        with self.reading("object_files"):
            return dict(read_tensor_file(self.path("object_files")).tensors)
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


def _digest(read: Callable[[Path], str], path: Path) -> str:
    try:
        return read(path)
    except FileNotFoundError:
        return "absent"
    except FormatError as error:
        return f"unreadable: {error}"


def _metadata_digest(path: Path) -> str:
    return hashlib.sha256(canonical_json(read_metadata(path)).encode()).hexdigest()
