"""Descriptions of products that lie far away, kept by the hash of their content."""

import contextlib
import json
import sqlite3
import zlib
from pathlib import Path
from types import TracebackType

from pipeline.audit.descriptions import Description

PLACE = Path(".objectfolder") / "audit.sqlite"
MOST_BYTES = 256 << 20  # about 100,000 products
LARGEST_BYTES = 64 << 20
_TABLE = (
    "CREATE TABLE IF NOT EXISTS described"
    " (md5 TEXT PRIMARY KEY, attributes BLOB NOT NULL, listing BLOB NOT NULL) WITHOUT ROWID"
)


class AttributeCache:
    """A cache beside the data set; losing it, or not being able to write it, costs time only.

    Parameters
    ----------
    root
        Root of the data set.
    """

    def __init__(self, root: Path) -> None:
        self._path = root / PLACE
        self._connection: sqlite3.Connection | None = None
        for _ in range(2):
            try:
                self._open()
                return
            except (sqlite3.Error, OSError):
                # Not a database, or one of another layout.
                with contextlib.suppress(OSError):
                    self._path.unlink(missing_ok=True)

    def __enter__(self) -> "AttributeCache":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._connection is not None:
            with contextlib.suppress(sqlite3.Error):
                self._connection.commit()
            self._connection.close()
            self._connection = None

    def get(self, md5: str) -> Description | None:
        """Return what is known of a content."""
        if self._connection is None:
            return None
        try:
            row = self._connection.execute(
                "SELECT attributes, listing FROM described WHERE md5 = ?", (md5,)
            ).fetchone()
            if row is None:
                return None
            attributes = json.loads(_unpacked(row[0]))
            return Description(attributes, _unpacked(row[1])) if isinstance(attributes, dict) else None
        except (sqlite3.Error, zlib.error, ValueError, TypeError, RecursionError):
            return None

    def put(self, md5: str, found: Description) -> None:
        """Keep what a content says of itself."""
        if self._connection is None:
            return
        packed = (zlib.compress(json.dumps(found.attributes).encode(), 1), zlib.compress(found.listing, 1))
        with contextlib.suppress(sqlite3.Error):
            self._connection.execute("INSERT OR REPLACE INTO described VALUES (?, ?, ?)", (md5, *packed))

    def _open(self) -> None:
        self._path.parent.mkdir(exist_ok=True)
        if self._path.is_file() and self._path.stat().st_size > MOST_BYTES:
            self._path.unlink()
        connection = sqlite3.connect(self._path, timeout=5.0)
        try:
            connection.execute(_TABLE)
            connection.execute("SELECT md5, attributes, listing FROM described LIMIT 1").fetchone()
        except sqlite3.Error:
            connection.close()
            raise
        self._connection = connection


def _unpacked(data: bytes) -> bytes:
    machine = zlib.decompressobj()
    found = machine.decompress(data, LARGEST_BYTES)
    if machine.unconsumed_tail:
        raise ValueError("larger than any description")
    return found
