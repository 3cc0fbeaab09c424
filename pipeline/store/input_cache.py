"""Files of a store kept on a worker's host, so that each is fetched once: capped, safe under kill -9.

Workers of one host share the folder without locks: a file appears under its name when it is whole, and
jobs work on links to it, so that one may remove what another reads.
"""

import contextlib
import os
import stat
import time
from collections.abc import Callable
from pathlib import Path

from objectfolder.errors import FormatError, InputError
from objectfolder.products.atomic import PARTIAL
from pipeline.store.copying import copy_file
from pipeline.store.storage import Store, number_of

FOLDER, CAP = "OBJECTFOLDER_CACHE", "OBJECTFOLDER_CACHE_GB"
DEFAULT_GB = 20.0
LEFT_BEHIND_S = 24 * 3600.0  # after which a half-written file no longer has a writer


class InputCache:
    """A folder of files by their names in a store.

    Parameters
    ----------
    folder
        Where; made at need.
    cap_bytes
        Size above which the files longest unused go.
    """

    def __init__(self, folder: Path, cap_bytes: int) -> None:
        self._folder = folder
        self._cap_bytes = cap_bytes

    def find(self, name: str, target: Path, check: Callable[[Path], None]) -> bool:
        """Put a file into place if it is here and whole; `check` raises FormatError where it is not."""
        try:
            _link(self._folder / name, target)
            check(target)
            os.utime(self._folder / name)
        except FormatError:
            target.unlink(missing_ok=True)
            (self._folder / name).unlink(missing_ok=True)
            return False
        except FileNotFoundError:
            return target.exists()  # removed by another after it was linked
        return True

    def fetch(self, store: Store, name: str, target: Path, check: Callable[[Path], None]) -> bool:
        """Put a file into place, from here or from `store`; False if neither has it.

        Raises
        ------
        FormatError
            It is damaged in the store; it is removed there.
        InputError, SimulationError
            The store or the disk cannot be used.
        """
        if self.find(name, target, check):
            return True
        if not store.get(name, target):
            return False
        try:
            check(target)
        except FormatError:
            target.unlink()
            store.remove(name)
            raise
        self.add(name, target)
        return True

    def add(self, name: str, path: Path) -> None:
        """Keep a file; where the disk does not allow it, it is fetched again another time."""
        with contextlib.suppress(OSError):
            _link(path, self._folder / name)
        self._evict()

    def _evict(self) -> None:
        found = []
        for path in self._folder.rglob("*"):
            with contextlib.suppress(OSError):
                status = path.stat()
                if not path.is_file():
                    continue
                if path.name.endswith(PARTIAL):
                    if status.st_mtime < time.time() - LEFT_BEHIND_S:
                        path.unlink(missing_ok=True)
                    continue
                found.append((status.st_mtime, status.st_size, path))
        excess = sum(size for _, size, _ in found) - self._cap_bytes
        for _, size, path in sorted(found):
            if excess <= 0:
                break
            path.unlink(missing_ok=True)
            excess -= size


def open_cache() -> InputCache:
    """Return this host's cache.

    Raises
    ------
    InputError
        ``OBJECTFOLDER_CACHE_GB`` is no number.
    """
    cap_bytes = int(1e9 * number_of(CAP, DEFAULT_GB))
    if named := os.environ.get(FOLDER):
        return InputCache(Path(named), cap_bytes)
    # Not TMPDIR, which is each child's own scratch folder.
    folder = (
        Path("/var/tmp" if os.path.isdir("/var/tmp") else Path.home()) / f"objectfolder-cache-{os.getuid()}"
    )
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
        raise InputError(
            str(folder), "belongs to another user", f"Remove it, or set {FOLDER} to a folder of yours."
        )
    return InputCache(folder, cap_bytes)


def _link(source: Path, target: Path) -> None:
    """Give a file another name, atomically; copy it where the two are on different disks."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.exists():
        return
    try:
        os.link(source, target)
    except FileExistsError:
        return
    except FileNotFoundError:
        raise
    except OSError:
        copy_file(source, target)
