"""Locks between processes, and failures of the file system as errors that name the path and the remedy."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock

from objectfolder.errors import InputError


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raise `InputError` in place of an `OSError`: no space, no permission, or another failure at `path`."""
    try:
        yield
    except OSError as error:
        raise InputError(
            str(path),
            f"cannot be read or written ({error.strerror or error})",
            "Check space and permissions of the folder, or name another: what was downloaded is kept.",
        ) from error


def locked(path: Path) -> contextlib.AbstractContextManager[object]:
    """Hold the lock file `path` until the context ends; another process or thread waits, however it ends."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        return FileLock(path).acquire()
