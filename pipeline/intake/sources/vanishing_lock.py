"""A lock between processes that leaves no file behind."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def vanishing_lock(path: Path) -> Iterator[None]:
    """Hold the file `path`; another process or thread waits until this one is done, however that ends.

    The file is there only while somebody holds it or was killed holding it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    while True:
        file = path.open("ab")  # to be written, or network file systems refuse to lock it
        fcntl.flock(file, fcntl.LOCK_EX)
        # Who held it before removed it: what was waited for is then no longer what others would wait for.
        if _is_at(path, file.fileno()):
            break
        file.close()
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        file.close()


def _is_at(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False
