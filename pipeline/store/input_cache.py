"""Files of a store kept on a worker's host, so that each is fetched once: capped, safe under kill -9.

Workers of one host share the folder without locks: a file appears under its name when it is whole, and
jobs work on copies (sharing blocks where the file system can), so that one may remove what another reads.
"""

import contextlib
import os
import stat
from collections.abc import Callable
from pathlib import Path

from objectfolder.errors import FormatError, ObjectFolderError
from pipeline.dataset.validation import number_of
from pipeline.store.storage import Store, excess, own_folder

FOLDER, CAP = "OBJECTFOLDER_CACHE", "OBJECTFOLDER_CACHE_GB"
DEFAULT_GB = 20.0


class InputCache:
    """A folder of files by their names in a store; above `cap_bytes`, the files longest unused go."""

    def __init__(self, folder: Path, cap_bytes: int) -> None:
        self._folder = folder.absolute()
        self._files = Store(str(self._folder))
        self._cap_bytes = cap_bytes

    def find(self, name: str, target: Path, check: Callable[[Path], None]) -> bool:
        """Put a file into place if it is here and whole; `check` raises FormatError where it is not."""
        try:
            is_whole = _get_whole(self._files, name, target, check)
        except FormatError:
            return False
        with contextlib.suppress(FileNotFoundError):
            os.utime(self._folder / name)
        return is_whole

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
        if not _get_whole(store, name, target, check):
            return False
        self.add(name, target)
        return True

    def add(self, name: str, path: Path) -> None:
        """Keep a file; where the disk does not allow it, it is fetched again another time."""
        with contextlib.suppress(ObjectFolderError, OSError):
            if self._files.size(name) is None:
                self._files.put(path, name)
        entries = []
        for file in self._folder.rglob("*"):
            with contextlib.suppress(OSError):
                status = file.stat()
                if stat.S_ISREG(status.st_mode):
                    entries.append((status.st_mtime, status.st_size, file))
        for file in excess(entries, self._cap_bytes):
            file.unlink(missing_ok=True)


def open_cache() -> InputCache:
    """Return this host's cache.

    Raises
    ------
    InputError
        ``OBJECTFOLDER_CACHE_GB`` is no number, or the folder belongs to another user.
    """
    cap_bytes = int(1e9 * number_of(CAP, DEFAULT_GB))
    if variable := os.environ.get(FOLDER):
        return InputCache(Path(variable), cap_bytes)
    # Not TMPDIR, which is each child's own scratch folder.
    place = Path("/var/tmp") if os.path.isdir("/var/tmp") else Path.home()
    return InputCache(own_folder(place / f"objectfolder-cache-{os.getuid()}", FOLDER), cap_bytes)


def _get_whole(store: Store, name: str, target: Path, check: Callable[[Path], None]) -> bool:
    """Get a file and check it; one that is damaged is removed, here and in the store."""
    if not store.get(name, target):
        return False
    try:
        check(target)
    except FormatError:
        target.unlink()
        store.remove(name)
        raise
    return True
