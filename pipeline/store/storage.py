"""A store of files at any fsspec URL: a file is whole under its name, or not there.

Object stores show an object when its upload is complete; in a folder a file is written under another
name and renamed. What is transient (a server's 500 or 503, a time-out, a connection reset, a body cut
short) is tried again, with pauses that grow, for a bounded time; all else is an error that names the
store, the finding and the remedy.
"""

import errno
import os
import random
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from objectfolder.atomic import PARTIAL
from objectfolder.errors import InputError, ObjectFolderError, SimulationError
from pipeline.store.copying import copy_file

STORE = "OBJECTFOLDER_STORE"
PATIENCE = "OBJECTFOLDER_STORE_PATIENCE_S"
DEFAULT_PATIENCE_S = 120.0
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.2, 10.0
# Of one request: to connect, and between two pieces of an answer.
TIMEOUTS = {"connect_timeout": 10, "read_timeout": 30}
NAME = re.compile(r"(sources/)?[0-9a-f]{2}/[0-9a-f]{64}(/[a-z_]+\.[a-z.]+)?")
NO_SPACE = frozenset({errno.ENOSPC, errno.EDQUOT})
# Errors of libraries for object stores that another try does not mend.
CREDENTIALS = frozenset({"NoCredentialsError", "PartialCredentialsError", "ProfileNotFound"})
MISNAMED = frozenset({"InvalidBucketName", "ParamValidationError", "InvalidRegionError"})
REFUSED = frozenset({"401", "403"})  # of HTTP
KEPT = "Nothing finished is lost: run again."

T = TypeVar("T")


class Store:
    """Files by name at a URL.

    Parameters
    ----------
    url
        ``s3://bucket/prefix``, ``gs://bucket/prefix``, ``file:///folder``, or an absolute path.
    patience_s
        Seconds during which something transient is tried again; None for what
        ``OBJECTFOLDER_STORE_PATIENCE_S`` says.

    Raises
    ------
    InputError
        A URL that names no store, or whose library is not installed.
    """

    def __init__(self, url: str, patience_s: float | None = None) -> None:
        self.url = url
        self._patience_s = default_patience_s() if patience_s is None else patience_s
        self._files, self._base = _file_system(url)
        protocols = self._files.protocol
        self._folder = Path(self._base) if "file" in protocols else None

    def check(self) -> None:
        """Look whether the store can be used.

        Raises
        ------
        InputError
            No such bucket, or no right to list it.
        SimulationError
            It cannot be reached.
        """
        folder = self._folder
        if folder is not None:
            self._patiently(lambda: folder.mkdir(parents=True, exist_ok=True))
            return
        try:
            self._patiently(lambda: self._files.ls(self._base, detail=False))
        except FileNotFoundError:
            return  # nothing there yet

    def size(self, name: str) -> int | None:
        """Return the size of a file in bytes; None if it is not there."""
        path = self._path(name)
        try:
            return int(self._patiently(lambda: self._files.info(path)["size"]))
        except FileNotFoundError:
            return None

    def put(self, source: Path, name: str) -> None:
        """Copy a file into the store.

        Raises
        ------
        InputError
            No such bucket, or no right to write.
        SimulationError
            The store is full or cannot be reached.
        """
        path = self._path(name)
        size = source.stat().st_size

        def upload() -> None:
            if self._folder is not None:
                copy_file(source, Path(path))
                return
            self._files.put_file(str(source), path)
            found = self._files.info(path)["size"]
            if found != size:  # some servers keep the part of an upload that broke off
                raise OSError(errno.EIO, f"{found} of {size} bytes arrived")

        try:
            self._patiently(upload)
        except FileNotFoundError as error:
            raise InputError(
                self.url, f"no such bucket ({error})", f"Create it, or correct {STORE}."
            ) from error

    def get(self, name: str, target: Path) -> bool:
        """Copy a file from the store, atomically; False if it is not there.

        Raises
        ------
        InputError
            No such bucket, or no right to read.
        SimulationError
            The store cannot be reached, or the disk is full.
        """
        path = self._path(name)

        def download() -> None:
            if self._folder is not None:
                copy_file(Path(path), target)
                return
            self._download(path, target)

        try:
            self._patiently(download, target.parent)
        except FileNotFoundError:
            return False
        return True

    def remove(self, name: str) -> None:
        """Remove a file, there or not."""
        path = self._path(name)
        try:
            self._patiently(lambda: self._files.rm_file(path))
        except FileNotFoundError:
            return

    def _download(self, path: str, target: Path) -> None:
        target.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(prefix=f".{target.name}.", suffix=PARTIAL, dir=target.parent)
        try:
            self._files.get_file(path, temporary)
            os.fsync(descriptor)
            os.replace(temporary, target)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
        finally:
            os.close(descriptor)

    def _path(self, name: str) -> str:
        if not NAME.fullmatch(name):
            raise ValueError(f"{name!r} is no name of a file in a store")
        return f"{self._base}/{name}"

    def _patiently(self, action: Callable[[], T], local: Path | None = None) -> T:
        """Do `action`, which may write into the folder `local`; FileNotFoundError: the file is not there."""
        end = time.monotonic() + self._patience_s
        pause = FIRST_PAUSE_S
        while True:
            try:
                return action()
            except ObjectFolderError:
                raise
            except Exception as error:
                if (told := self._told(error, local)) is not None:
                    raise told from error
                # Each library for object stores has errors of its own: all of them are the store's.
                if isinstance(error, FileNotFoundError) or (
                    self._folder is not None and not isinstance(error, OSError | EOFError)
                ):
                    raise
                if time.monotonic() + pause > end:
                    finding = f"no success in {self._patience_s:g} s of tries (last: {_said(error)})"
                    remedy = f"See whether it runs and can be reached from here. {KEPT}"
                    raise SimulationError(self.url, finding, remedy) from error
            time.sleep(pause * random.uniform(0.5, 1.0))  # random, so that many workers do not try at once
            pause = min(2 * pause, LONGEST_PAUSE_S)

    def _told(self, error: Exception, local: Path | None) -> ObjectFolderError | None:
        """Return the error to show for one that another try does not mend."""
        if isinstance(error, OSError):
            # Only the operating system names a file in such an error.
            here = error.filename is not None or self._folder is not None
            if error.errno in NO_SPACE:
                return disk_error(error, local or Path(self._base)) if here or local else None
            if error.errno == errno.EROFS or (isinstance(error, PermissionError) and here):
                return disk_error(error, Path(str(error.filename or local or self._base)))
        status = getattr(error, "status_code", None) or getattr(error, "code", None)  # of Azure, of Google
        if isinstance(error, PermissionError) or str(status) in REFUSED:
            remedy = "Check the credentials; they need the rights to list, read, write and delete."
            return InputError(self.url, f"access denied ({error})", remedy)
        if any("NoSuchBucket" in str(cause) for cause in _causes(error)):
            return InputError(self.url, "no such bucket", f"Create it, or correct {STORE}.")
        if type(error).__name__ in MISNAMED:
            return InputError(self.url, _said(error), f"Correct {STORE}.")
        if type(error).__name__ in CREDENTIALS:
            return InputError(
                self.url, _said(error), "Set the credentials as the store's library asks (AWS_...)."
            )
        return None


def default_patience_s() -> float:
    """Return how long to try again, in seconds.

    Raises
    ------
    InputError
        ``OBJECTFOLDER_STORE_PATIENCE_S`` is no number.
    """
    text = os.environ.get(PATIENCE, str(DEFAULT_PATIENCE_S))
    try:
        return float(text)
    except ValueError:
        raise InputError(PATIENCE, f"{text!r} is no number", "Give seconds.") from None


def disk_error(error: OSError, folder: Path) -> ObjectFolderError:
    """Return the project's error for an error of the operating system in a folder."""
    if error.errno in NO_SPACE:
        return SimulationError(str(folder), "no space left", f"Free space there. {KEPT}")
    finding = f"cannot be used ({error.strerror or error})"
    return InputError(str(folder), finding, "Correct the rights or the disk of this folder.")


def product_name(fingerprint: str, file_name: str) -> str:
    """Return the name in a store of a product: `file_name` is its kind and suffix."""
    return f"{fingerprint[:2]}/{fingerprint}/{file_name}"


def source_name(digest: str) -> str:
    """Return the name in a store of a source file with this SHA-256."""
    return f"sources/{digest[:2]}/{digest}"


def _file_system(url: str) -> tuple[Any, str]:
    import fsspec
    from fsspec.config import conf

    protocol = url.partition("://")[0] if "://" in url else "file"
    if protocol == "file" and not url.removeprefix("file://").startswith("/"):
        raise InputError(url, "a relative path", f"Give {STORE} a URL or an absolute path.")
    options: dict[str, Any] = {}
    if protocol in ("s3", "s3a"):
        # The pauses between tries are this module's; what the user configures for fsspec stands.
        settings = {**TIMEOUTS, "retries": {"total_max_attempts": 1}}
        settings.update(conf.get(protocol, {}).get("config_kwargs", {}))
        options = {"config_kwargs": settings, "use_listings_cache": False, "skip_instance_cache": True}
    try:
        files, base = fsspec.core.url_to_fs(url, **options)
    except ImportError as error:
        raise InputError(url, str(error), "Install the project's extra `s3`, or that library.") from error
    except ValueError as error:
        raise InputError(url, str(error), f"Correct {STORE}: s3://bucket/prefix, file:///folder.") from error
    if protocol in ("s3", "s3a"):
        files.retries = 1
    return files, base.rstrip("/")


def _causes(error: BaseException | None) -> list[BaseException]:
    found: list[BaseException] = []
    while error is not None and error not in found:
        found.append(error)
        error = error.__cause__ or error.__context__
    return found


def _said(error: Exception) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text[:200]}" if text else type(error).__name__
