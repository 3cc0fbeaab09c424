"""A file kept for an address: what has come of it, what that is a part of, and the whole once verified.

All lies in one folder named by the address. The file has its final name only when it is whole; its record
says what it was then, so that damage since is seen. One process at a time works in the folder.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from objectfolder.atomic import atomic_write
from objectfolder.errors import InputError


@dataclass(frozen=True)
class Digests:
    """What a file's content is: bytes and hashes."""

    size: int
    sha256: str
    md5: str

    @classmethod
    def of(cls, path: Path) -> "Digests":
        """Read a file once for all of them."""
        sha256, md5 = hashlib.sha256(), hashlib.md5(usedforsecurity=False)
        size = 0
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                sha256.update(block)
                md5.update(block)
                size += len(block)
        return cls(size, sha256.hexdigest(), md5.hexdigest())


@dataclass(frozen=True)
class Whole:
    """What a partial file is a part of.

    Parameters
    ----------
    asked
        Hash of the address that was asked, a mirror's where there is one.
    validator
        Strong ``ETag`` or else ``Last-Modified``; empty where the server gives neither.
    total
        Bytes of the whole; None where the server does not say.
    """

    asked: str
    validator: str
    total: int | None


class CachedFile:
    """The folder of an address in a cache.

    Parameters
    ----------
    cache
        Folder of all of them.
    url
        The address, whatever mirror it is fetched from.
    """

    def __init__(self, cache: Path, url: str) -> None:
        self.folder = cache / hashlib.sha256(url.encode("utf-8", "surrogatepass")).hexdigest()[:32]
        self.path = self.folder / _file_name(url)
        self.partial = self.folder / ".partial"
        self._whole = self.folder / ".partial.json"
        self._record = self.folder / ".record.json"
        self._url = url

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Hold the folder; another process or thread waits until this one is done."""
        with writing(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            lock = (self.folder / ".lock").open("ab")
        with lock:
            with writing(self.folder):
                fcntl.flock(lock, fcntl.LOCK_EX)  # ends with its process, however that ends
            yield

    def kept(self) -> Digests | None:
        """Return what the whole file is; None where there is none, or it is no longer what it was."""
        said = _read(self._record)
        if not self.path.is_file():
            return None
        with writing(self.path):
            found = Digests.of(self.path)
        return found if said.get("sha256") == found.sha256 else None

    def come(self) -> tuple[int, Whole | None]:
        """Return how many bytes are there of what; 0 of nothing where they cannot be gone on from."""
        said = _read(self._whole)
        try:
            whole = Whole(str(said["asked"]), str(said["validator"]), said["total"])
            count = self.partial.stat().st_size
        except (KeyError, OSError):
            return 0, None
        if not isinstance(whole.total, int | None) or (whole.total is not None and count > whole.total):
            return 0, None
        return count, whole

    def begin(self, whole: Whole) -> None:
        """Forget what has come, and note what is to come."""
        with writing(self.partial):
            # In this order a process killed in between leaves nothing that looks like a part of `whole`.
            self.discard()
            self.partial.touch()
            with atomic_write(self._whole) as file:
                file.write(json.dumps(asdict(whole)).encode())

    def check_space(self, count: int) -> None:
        """Raise `InputError` where the disk has not `count` more bytes."""
        with writing(self.folder):
            free = shutil.disk_usage(self.folder).free
        if count > free:
            raise InputError(
                str(self.folder),
                f"{count} bytes of {self._url} are to come and {free} are free",
                "Free space, or name a cache elsewhere: what has come is kept.",
            )

    def discard(self) -> None:
        """Remove what has come."""
        with writing(self.partial):
            self._whole.unlink(missing_ok=True)
            self.partial.unlink(missing_ok=True)

    def finish(self, found: Digests) -> None:
        """Give what has come its name."""
        with writing(self.path):
            with self.partial.open("rb") as file:
                os.fsync(file.fileno())
            with atomic_write(self._record) as file:
                file.write(json.dumps({"url": self._url, **asdict(found)}).encode())
            os.replace(self.partial, self.path)
            self._whole.unlink(missing_ok=True)

    def forget(self) -> None:
        """Remove everything."""
        with writing(self.path):
            self._record.unlink(missing_ok=True)
            self.path.unlink(missing_ok=True)
        self.discard()


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the disk refuses into an error that says what to do.

    Raises
    ------
    InputError
        No space, no permission, or another failure of the file system.
    """
    try:
        yield
    except OSError as error:
        raise InputError(
            str(path),
            f"cannot be read or written ({error.strerror or error})",
            "Check space and permissions of the folder, or name another: what has come is kept.",
        ) from error


def _file_name(url: str) -> str:
    """Return the last part of an address as a plain file name, never hidden and never empty."""
    last = unquote(urlsplit(url).path).rpartition("/")[2]
    return re.sub(r"[^A-Za-z0-9._-]", "_", last).lstrip(".")[-100:].lstrip(".") or "file"


def _read(path: Path) -> dict[str, Any]:
    """Read what was noted; nothing where it is absent or damaged."""
    try:
        said = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return said if isinstance(said, dict) else {}
