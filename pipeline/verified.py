"""Which products were checked whole, by size, time and inode, so that each is read through only once."""

import json
from pathlib import Path

from objectfolder.atomic import atomic_write
from objectfolder.errors import FormatError
from pipeline import products


class Verified:
    """A cache beside the data set; losing it costs time only.

    Parameters
    ----------
    root
        Root of the data set.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._path = root / ".objectfolder" / "verified.json"
        try:
            self._seen: dict[str, list[int]] = json.loads(self._path.read_text())
        except (OSError, ValueError):
            self._seen = {}

    def holds(self, path: Path, fingerprint: str) -> bool:
        """Whether `path` is a whole product with this fingerprint."""
        try:
            if products.read_fingerprint(path) != fingerprint:
                return False
            if self._seen.get(self._key(path)) != _state(path):
                products.verify(path)
                self.add(path)
        except FormatError:
            return False
        return True

    def add(self, path: Path) -> None:
        """Note a product as checked."""
        self._seen[self._key(path)] = _state(path)

    def save(self) -> None:
        """Write the cache, without files that are gone."""
        self._seen = {key: state for key, state in self._seen.items() if (self._root / key).exists()}
        with atomic_write(self._path) as file:
            file.write(json.dumps(self._seen).encode())

    def _key(self, path: Path) -> str:
        return path.relative_to(self._root).as_posix()


def _state(path: Path) -> list[int]:
    status = path.stat()
    return [status.st_size, status.st_mtime_ns, status.st_ino]
