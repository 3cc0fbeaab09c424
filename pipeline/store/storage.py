"""A store of files at a URL: a file is whole under its name, or not there.

obstore speaks to S3, Google Cloud Storage and Azure. It tries again what is transient (a server's 500 or 503,
a time-out, a connection reset, a body cut short), with pauses that grow, for a bounded time. What remains is
an error that names the store, the finding and the remedy. A folder is a store, too: there a file is written
under another name and renamed.
"""

import contextlib
import errno
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError, MissingPackageError, ObjectFolderError, SimulationError
from objectfolder.extras import needs_extra
from objectfolder.products.atomic import atomic_write
from objectfolder.products.regular_file import open_regular
from pipeline.dataset.validation import number_of

STORE = "OBJECTFOLDER_STORE"
PATIENCE = "OBJECTFOLDER_STORE_PATIENCE_S"
DEFAULT_PATIENCE_S = 120.0
PAUSES = {"init_backoff": timedelta(seconds=0.2), "max_backoff": timedelta(seconds=10), "base": 2}
# Of one request: to connect, between two pieces of an answer, and in all.
TIMEOUTS = {"connect_timeout": "10s", "read_timeout": "30s", "timeout": "1h"}
NAME = re.compile(r"(sources/)?[0-9a-f]{2}/[0-9a-f]{64}(/[a-z_]+\.[a-z.]+)?")
FICLONE = 0x40049409  # ioctl of Linux: share the blocks of another file
NO_SPACE = frozenset({errno.ENOSPC, errno.EDQUOT})
DENIED = re.compile(r"status code: 40[13]\b")  # of HTTP, as obstore writes it
KEPT = "Nothing finished is lost: run again."


class Store:
    """Files by name at a URL.

    Parameters
    ----------
    url
        ``s3://bucket/prefix``, ``gs://bucket/prefix``, ``abfs://container/prefix``, ``file:///folder``, or an
        absolute path.
    patience_s
        Seconds during which something transient is tried again; None for what
        ``OBJECTFOLDER_STORE_PATIENCE_S`` says.

    Raises
    ------
    InputError
        A URL that names no store, or no credentials for it; from every method: no such bucket, or no right
        to do this.
    SimulationError
        From every method: the store cannot be reached, or a disk is full.
    """

    def __init__(self, url: str, patience_s: float | None = None) -> None:
        self.url = url
        self._patience_s = number_of(PATIENCE, DEFAULT_PATIENCE_S) if patience_s is None else patience_s
        self._folder = (
            Path(url.removeprefix("file://")) if "://" not in url or url.startswith("file:") else None
        )
        if self._folder is None:
            self._files = self._opened()
        elif not self._folder.is_absolute():
            raise InputError(url, "a relative path", f"Give {STORE} a URL or an absolute path.")

    def check(self) -> None:
        """Look whether the store can be used."""
        with self._errors():
            if self._folder is not None:
                self._folder.mkdir(parents=True, exist_ok=True)
            else:
                self._files.list_with_delimiter()

    def size(self, name: str) -> int | None:
        """Return the size of a file in bytes; None if it is not there."""
        path = self._path(name)
        with contextlib.suppress(FileNotFoundError), self._errors():
            return path.stat().st_size if isinstance(path, Path) else int(self._files.head(path)["size"])
        return None

    def put(self, source: Path, name: str) -> None:
        """Copy a file into the store."""
        path = self._path(name)
        with self._errors():
            if isinstance(path, Path):
                copy_file(source, path)
            else:
                self._files.put(path, source, use_multipart=False)  # one request: all of it, or nothing

    def get(self, name: str, target: Path) -> bool:
        """Copy a file from the store, atomically; False if it is not there."""
        path = self._path(name)
        with contextlib.suppress(FileNotFoundError), self._errors(target.parent):
            if isinstance(path, Path):
                copy_file(path, target)
            else:
                content = self._files.get(path)
                with atomic_write(target) as file:
                    for part in content.stream():
                        file.write(part)
            return True
        return False

    def get_all(self, names: Sequence[str], targets: Sequence[Path]) -> bool:
        """Copy files from the store until one is not there; False then."""
        return all(self.get(name, target) for name, target in zip(names, targets, strict=True))

    def remove(self, name: str) -> None:
        """Remove a file, there or not."""
        path = self._path(name)
        with contextlib.suppress(FileNotFoundError), self._errors():
            if isinstance(path, Path):
                path.unlink()
            else:
                self._files.delete(path)

    def _path(self, name: str) -> Path | str:
        if not NAME.fullmatch(name):
            raise ValueError(f"{name!r} is no name of a file in a store")
        return name if self._folder is None else self._folder / name

    def _opened(self) -> Any:
        from obstore.store import from_url

        patience = timedelta(seconds=self._patience_s)
        options: dict[str, Any] = {
            "client_options": {**TIMEOUTS, "allow_http": True},
            "retry_config": {"max_retries": 10_000, "retry_timeout": patience, "backoff": PAUSES},
        }
        try:
            if self.url.startswith(("s3:", "s3a:")):
                with needs_extra("s3"):
                    import boto3  # noqa: F401  (the next line needs it)
                from obstore.auth.boto3 import Boto3CredentialProvider  # knows profiles, too

                options["credential_provider"] = Boto3CredentialProvider()
            return from_url(self.url, **options)
        except MissingPackageError:
            raise
        except Exception as error:  # of the URL or the credentials; each library has errors of its own
            remedy = f"Correct {STORE} (s3://bucket/prefix, file:///folder) or the credentials (AWS_...)."
            raise InputError(self.url, _said(error), remedy) from error

    @contextlib.contextmanager
    def _errors(self, local: Path | None = None) -> Iterator[None]:
        """Raise the project's errors, and FileNotFoundError; `local` is the folder that is written into."""
        from obstore.exceptions import BaseError

        try:
            yield
        except (OSError, BaseError) as error:
            text = _said(error)
            if "NoSuchBucket" in text:
                raise InputError(self.url, "no such bucket", f"Create it, or correct {STORE}.") from error
            if isinstance(error, FileNotFoundError):
                raise
            if isinstance(error, OSError):
                raise disk_error(error, error.filename or local or self._folder or self.url) from error
            if DENIED.search(text):
                remedy = "Check the credentials; they need the rights to list, read, write and delete."
                raise InputError(self.url, f"access denied ({text})", remedy) from error
            finding = f"no success ({text}), tried again for {self._patience_s:g} s at most"
            remedy = f"See whether it runs and can be reached from here. {KEPT}"
            raise SimulationError(self.url, finding, remedy) from error


def copy_file(source: Path, target: Path) -> None:
    """Copy a file atomically, by reference where the file system can."""
    with open_regular(source) as original, atomic_write(target) as file:
        try:
            import fcntl

            fcntl.ioctl(file.fileno(), FICLONE, original.fileno())
        except (ImportError, OSError):
            shutil.copyfileobj(original, file, 1 << 20)


def excess(entries: Iterable[tuple[float, int, Path]], cap_bytes: int) -> Iterator[Path]:
    """Yield the paths longest unused until the others fit the cap; an entry is (time, bytes, path)."""
    oldest = sorted(entries)
    total = sum(size for _, size, _ in oldest)
    for _, size, path in oldest:
        if total <= cap_bytes:
            return
        yield path
        total -= size


def own_folder(path: Path, variable: str) -> Path:
    """Return a folder that is this user's, made if absent and then closed to others.

    Raises
    ------
    InputError
        It belongs to somebody else; the environment variable says which folder is used.
    """
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    if path.is_symlink() or path.stat().st_uid != os.getuid():
        remedy = f"Remove it, or set {variable} to a folder of yours."
        raise InputError(str(path), "belongs to another user", remedy)
    return path


def disk_error(error: OSError, folder: Path | str) -> ObjectFolderError:
    """Return the project's error for an error of the operating system in a folder."""
    if error.errno in NO_SPACE:
        return SimulationError(str(folder), "no space left", f"Free space there. {KEPT}")
    if isinstance(error, IsADirectoryError):  # of a file that takes its name, the second name is that
        where = str(error.filename2 or error.filename or folder)
        return InputError(where, "is a folder, not a file", "Move it away; a run makes the file.")
    finding = f"cannot be used ({error.strerror or error})"
    return InputError(str(folder), finding, "Correct the rights or the disk of this folder.")


def product_name(fingerprint: str, file_name: str) -> str:
    """Return the name in a store of a product: `file_name` is its kind and suffix."""
    return f"{fingerprint[:2]}/{fingerprint}/{file_name}"


def source_name(digest: str) -> str:
    """Return the name in a store of a source file with this SHA-256."""
    return f"sources/{digest[:2]}/{digest}"


def _said(error: Exception) -> str:
    """Return what a library says, in one line, without the server's page and the dump of the error."""
    return " ".join(str(error).partition("Debug source")[0].split()) or type(error).__name__
