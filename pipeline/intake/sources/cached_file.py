"""A downloaded file and its parts, in a folder of a cache that processes share."""

import hashlib
import json
import os
import re
from contextlib import AbstractContextManager
from pathlib import Path
from urllib.parse import unquote, urlsplit

from objectfolder.atomic import atomic_write
from pipeline.intake.disk import locked, writing


class CachedFile:
    """The folder of an address; the file has its final name only once it is verified.

    Parameters
    ----------
    cache
        Folder of all of them.
    url
        The address as the source gives it.
    asked
        The address that is asked, a mirror's where there is one.
    """

    def __init__(self, cache: Path, url: str, asked: str) -> None:
        self.folder = cache / _sha256(url)[:32]
        self.path = self.folder / _file_name(url)
        self.partial = self.folder / ".partial"
        self._note = self.folder / ".partial.json"
        self._asked = _sha256(
            asked
        )  # a mirror's address may have a password in it, which is not for the disk

    def locked(self) -> AbstractContextManager[object]:
        """Lock the folder; another process or thread waits."""
        return locked(self.folder / ".lock")

    def resumable(self) -> tuple[int, str]:
        """Return the bytes that are there and the validator of their version; 0 where they cannot be used."""
        try:
            note = json.loads(self._note.read_bytes())
            count = self.partial.stat().st_size
            usable = note["asked"] == self._asked and isinstance(note["validator"], str)
        except (OSError, ValueError, LookupError, TypeError, RecursionError):
            return 0, ""
        return (count, note["validator"]) if usable and note["validator"] else (0, "")

    def begin(self, validator: str) -> None:
        """Discard the part that is there, and note the version of the next."""
        # In this order a killed process leaves nothing that looks like a part of another version.
        self.discard()
        with writing(self.partial):
            self.partial.touch()
            with atomic_write(self._note) as file:
                file.write(json.dumps({"asked": self._asked, "validator": validator}).encode())

    def finish(self) -> None:
        """Give the whole file its name."""
        with writing(self.path):
            with self.partial.open("rb") as file:
                os.fsync(file.fileno())
            os.replace(self.partial, self.path)
            self._note.unlink(missing_ok=True)

    def discard(self) -> None:
        """Remove the part that is there."""
        with writing(self.partial):
            self._note.unlink(missing_ok=True)
            self.partial.unlink(missing_ok=True)

    def forget(self) -> None:
        """Remove the file and its part."""
        with writing(self.path):
            self.path.unlink(missing_ok=True)
        self.discard()


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _file_name(url: str) -> str:
    """Return the last part of an address as a plain file name, never hidden and never empty."""
    last = unquote(urlsplit(url).path).rpartition("/")[2]
    return re.sub(r"[^A-Za-z0-9._-]", "_", last).lstrip(".")[-100:].lstrip(".") or "file"
