"""Product files: one an object and kind, each carrying the fingerprint of what it was made from."""

import functools
import hashlib
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError
from objectfolder.products.atomic import PARTIAL
from objectfolder.products.regular_file import open_regular

# Folder beside a data set and outside its versions; losing it costs time only.
STATE = ".objectfolder"
PLAYERS = f"{STATE}/players"  # data of players, by the content of the Object File
ZARR = ".zarr.zip"
TENSORS = ".safetensors"


@dataclass(frozen=True)
class ProductKind:
    """A folder with one file an object.

    Parameters
    ----------
    folder
        Relative to the root of the data set, such as ``data/views``; its last part names the kind.
    suffix
        `ZARR` or `TENSORS`.
    stage
        Which stage makes it; empty where the kind's name is the stage's.
    """

    folder: str
    suffix: str = ZARR
    stage: str = ""

    @property
    def made_by(self) -> str:
        """Name of the stage that makes it."""
        return self.stage or self.name

    @functools.cached_property
    def name(self) -> str:
        """Last part of the folder."""
        return self.folder.rpartition("/")[2]

    def path(self, root: Path, object_id: str) -> Path:
        """Return the path of the product of an object."""
        return _path(_folder(root, self.folder), f"{object_id}{self.suffix}")

    def object_ids(self, root: Path) -> list[str]:
        """Return the ids that have a file, whole or not."""
        folder = root / self.folder
        if not folder.is_dir():
            return []
        return sorted(
            name.removesuffix(self.suffix)
            for name in os.listdir(folder)
            if name.endswith(self.suffix) and not name.startswith(".")
        )

    def sweep(self, root: Path) -> None:
        """Remove half-written files of an interrupted run."""
        for path in (root / self.folder).glob(f".*{PARTIAL}"):
            path.unlink(missing_ok=True)


@functools.lru_cache(maxsize=64)
def _folder(root: Path, folder: str) -> Path:
    return root / folder


@functools.lru_cache(maxsize=64)  # stages name the products of an object again and again
def _path(folder: Path, name: str) -> Path:
    return folder / name


def read_description(path: Path) -> dict[str, Any]:
    """Return the attributes of a product.

    Raises
    ------
    FileNotFoundError
        There is no product.
    FormatError
        A file that cannot be read.
    """
    if not path.name.endswith(TENSORS):
        from pipeline.dataset import archives

        return archives.read_attributes(path)
    from objectfolder.products.tensor_file import read_metadata

    return dict(read_metadata(path))


def read_fingerprint(path: Path) -> str | None:
    """Return the fingerprint in a product; None where there is no file.

    Raises
    ------
    FormatError
        A file that cannot be read, or has no fingerprint.
    """
    try:
        fingerprint = read_description(path).get("fingerprint")
    except FileNotFoundError:
        return None
    if not isinstance(fingerprint, str):
        raise FormatError(str(path), "it carries no fingerprint", "Delete it; a run makes it again.")
    return fingerprint


def md5_of(path: Path | str) -> str:
    """Return the MD5 of a file, 32 hex digits: the name under which DVC's cache has it."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()


def kind_name(path: Path | str) -> str:
    """Return the name of a product without its object: kind and suffix."""
    folder, _, name = str(path).rpartition(os.sep)
    return f"{folder.rpartition(os.sep)[2]}{TENSORS if name.endswith(TENSORS) else ZARR}"


def check(path: Path, fingerprint: str) -> None:
    """Raise FormatError unless a product is whole and has this fingerprint."""
    verify(path)
    if read_fingerprint(path) != fingerprint:
        finding = "its fingerprint differs from that in its name"
        raise FormatError(str(path), finding, "Delete it; a run makes it again.")


def are_whole(paths: Iterable[Path], fingerprint: str) -> bool:
    """Return whether all products are there, whole and with this fingerprint."""
    try:
        for path in paths:
            check(path, fingerprint)
    except (OSError, FormatError):
        return False
    return True


def verify(path: Path) -> None:
    """Read all of a product and check it against the checksums it carries.

    Raises
    ------
    FormatError
        A damaged file.
    """
    if path.name.endswith(TENSORS):
        from objectfolder.products.tensor_file import DIGEST, read_tensor_file

        if DIGEST not in read_tensor_file(path).metadata:
            raise FormatError(str(path), "it carries no content digest", "Delete it; a run makes it again.")
        return
    from pipeline.dataset import archives

    archives.check(path)
