"""Files by MD5 in a repository's DVC cache and at its remote; a fetched file is hashed before it is used."""

import hashlib
import os
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

from objectfolder.errors import InputError, ObjectFolderError
from pipeline.dataset.archives import LARGEST_PRODUCT_BYTES
from pipeline.dataset.lock_file import read_folder
from pipeline.dataset.products import TENSORS, ZARR, md5_of

BLOCK_BYTES = 2 << 20
ATTEMPTS = 4
# A file takes 75 bytes of a list. Products are what their readers allow (`pipeline.dataset.archives`).
MOST_LIST_BYTES = 64 << 20
MOST_BYTES = {TENSORS: 1 << 30, ZARR: LARGEST_PRODUCT_BYTES, "": LARGEST_PRODUCT_BYTES}
FETCH = "Fetch it: `dvc fetch --all-commits`, or name the remote that has it with --remote."
Progress = Callable[[int], None]


class NotHere(ObjectFolderError):
    """A content that is neither in the cache nor at the remote."""


class Stores:
    """The cache and the remote of a repository.

    Parameters
    ----------
    repository
        An open `dvc.repo.Repo`.
    remote
        Name of a remote of DVC; the default one where it is empty.
    remedy
        What to do about a content that neither has.
    """

    def __init__(self, repository: Any, remote: str = "", remedy: str = FETCH) -> None:
        self.repository = repository
        self._remote_name, self._remedy = remote, remedy
        caches = (repository.cache.local, repository.cache.legacy)
        self._caches = [odb for odb in caches if odb is not None]
        # As texts: versions of a thousand objects ask for fourteen thousand files.
        self._folders = [str(odb.path) for odb in self._caches]
        self._no_remote = ""

    @cached_property
    def remote(self) -> Any:
        """The remote; None where none is set.

        Raises
        ------
        InputError
            It was named, and the repository has none of this name, or it cannot be used.
        """
        from dvc.config import NoRemoteError

        try:
            return self.repository.cloud.get_remote_odb(self._remote_name or None)
        except Exception as error:  # none is set, or its settings or its library are missing
            if self._remote_name:
                remotes = ", ".join(sorted(self.repository.config["remote"])) or "none"
                finding = f"no such remote, or it cannot be used ({str(error).rstrip('.')})"
                raise InputError(self._remote_name, finding, f"The repository has {remotes}.") from error
            reason = str(error).partition("\n")[0].rstrip(".")
            self._no_remote = "no remote is set" if isinstance(error, NoRemoteError) else reason
            return None

    def path(self, md5: str) -> Path | None:
        """Return the file of the cache that should have this content."""
        for folder in self._folders:
            file = f"{folder}{os.sep}{md5[:2]}{os.sep}{md5[2:]}"
            if os.path.isfile(file):
                return Path(file)
        return None

    def folder(self, md5: str, where: str) -> dict[str, str]:
        """Return the files of a folder, path inside it to MD5.

        Raises
        ------
        NotHere
            Its list is neither in the cache nor at the remote.
        FormatError
            A damaged one.
        """
        problems: list[str] = []
        for name, odb in self._sources():
            try:
                with odb.fs.open(odb.oid_to_path(md5), "rb") as file:
                    text: bytes = file.read(MOST_LIST_BYTES + 1)
            except FileNotFoundError:
                continue
            except Exception as error:  # each kind of store has its own
                problems.append(_store_error(name, error))
                continue
            if len(text) > MOST_LIST_BYTES:
                problems.append(f"{name}: a list of more than {MOST_LIST_BYTES} bytes")
                continue
            if hashlib.md5(text, usedforsecurity=False).hexdigest() == md5.partition(".")[0]:
                return read_folder(where, text)
            problems.append(f"{name}: what is stored as {md5} is damaged")
        raise self._missing(md5, where, problems)

    def fetch(self, md5: str, target: Path, where: str, progress: Progress = lambda count: None) -> None:
        """Fetch a content into a file.

        Parameters
        ----------
        md5
            Of the content.
        target
            The file; only once this returns, it has the content.
        where
            What to call the content in errors; its suffix says which kind it is, and so how large it may be.
        progress
            Called with the number of new bytes as they come.

        Raises
        ------
        NotHere
            No store has it, or none has it whole and can be read.
        InputError
            `target` cannot be written.
        """
        most = next(most for suffix, most in MOST_BYTES.items() if where.endswith(suffix))
        problems: list[str] = []
        for name, odb in self._sources():
            for _ in range(ATTEMPTS):
                try:
                    with target.open("wb") as file:
                        _copy(odb.fs, odb.oid_to_path(md5), file, progress, most)
                except FileNotFoundError:
                    break
                except _TooLargeError as error:
                    problems.append(f"{name}: {error}")
                    break
                except InputError:
                    raise
                except Exception as error:  # each kind of store has its own
                    problems.append(_store_error(name, error))
                    continue
                if md5_of(target) == md5:
                    return
                problems.append(f"{name}: {target.stat().st_size} bytes that are not {md5}")
        target.unlink(missing_ok=True)
        raise self._missing(md5, where, problems)

    def _sources(self) -> Iterator[tuple[str, Any]]:
        yield from (("the cache", odb) for odb in self._caches)
        if self.remote is not None:
            yield f"the remote {self.remote.path}", self.remote

    def _missing(self, md5: str, where: str, problems: list[str]) -> NotHere:
        if problems:
            finding = f"not readable here: {md5} ({'; '.join(dict.fromkeys(problems))})"
            remedy = "Check that these credentials reach the remote (`dvc status -c`), and try again."
            return NotHere(where, finding, remedy)
        nowhere = f"not in the cache, and {self._no_remote}"
        if self.remote is not None:
            nowhere = "neither in the cache nor at the remote"
        return NotHere(where, f"not readable here: {md5} is {nowhere}", self._remedy)


class _TooLargeError(Exception):
    """A content whose stored size exceeds that of any product of its kind."""


def _copy(fs: Any, source: str, file: BinaryIO, progress: Progress, most: int) -> None:
    """Write the bytes of `source` to a file."""
    size = fs.info(source)["size"]
    if size is None:
        raise OSError("its store does not say how large it is")
    if size > most:
        raise _TooLargeError(f"{size} bytes, more than the {most} of any product of this kind")
    with fs.open(source, "rb") as stream:
        while block := stream.read(BLOCK_BYTES):
            try:
                file.write(block)
                file.flush()
            except OSError as error:  # a full disk is no fault of the store
                finding = f"cannot be written ({error.strerror})"
                raise InputError(str(file.name), finding, "Make room.") from error
            progress(len(block))
    if file.tell() != size:
        raise ConnectionError(f"{file.tell()} of {size} bytes arrived")


def _store_error(store: str, error: Exception) -> str:
    return f"{store}: {type(error).__name__}: {error}".strip().replace("\n", " ")
