"""The products of one object that its page shows: read where they are there, told apart by what they hold."""

from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.tensor_file import DIGEST, read_metadata, read_tensor_file
from pipeline.report.archive import Archive, content_digest

TRUTHS = ("objects", "views", "modes", "touches")
ARCHIVES = (*TRUTHS, "fidelity")
TENSORS = ("encoded", "object_files")


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
        for stage in TENSORS:
            found[stage] = _digest(lambda path: read_metadata(path)[DIGEST], self.tensors(stage, object_id))
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

    def object_file_tensors(self) -> dict[str, np.ndarray]:
        """Return the arrays of the Object File; none where it is absent or unreadable."""
        try:
            return dict(read_tensor_file(self.shelf.tensors("object_files", self.object_id)).tensors)
        except FileNotFoundError:
            return {}
        except FormatError as error:
            self.unreadable.append(f"object_files: {error.finding}")
            return {}


def _digest(read: Any, path: Path) -> str:
    try:
        return str(read(path))
    except FileNotFoundError:
        return "absent"
    except (FormatError, KeyError) as error:
        return f"unreadable: {error}"
