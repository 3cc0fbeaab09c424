"""A downloaded file and its parts, in a folder of a cache that processes share."""

import hashlib
import os
import re
from contextlib import AbstractContextManager
from pathlib import Path
from urllib.parse import unquote, urlsplit

from objectfolder.products.atomic import atomic_write
from pipeline.intake.disk import locked, writing


class CachedFile:
    """The folder of an address; the file has its final name only once it is verified."""

    def __init__(self, cache: Path, url: str) -> None:
        address = url.encode("utf-8", "surrogatepass")
        self.folder = cache / hashlib.sha256(address).hexdigest()[:32]
        self.path = self.folder / _file_name(url)
        self.partial = self.folder / ".partial"
        self._validator = self.folder / ".partial.validator"

    def locked(self) -> AbstractContextManager[object]:
        """Lock the folder; another process or thread waits."""
        return locked(self.folder / ".lock")

    def resumable(self) -> tuple[int, str]:
        """Return the bytes that are there and the validator of their version; 0 where they cannot be used."""
        try:
            validator = self._validator.read_text("latin-1")
            return (self.partial.stat().st_size, validator) if validator else (0, "")
        except OSError:
            return 0, ""

    def begin(self, validator: str) -> None:
        """Discard the part that is there, and note the version of the next."""
        # In this order a killed process leaves nothing that looks like a part of another version.
        self.discard()
        with writing(self.partial):
            self.partial.touch()
            with atomic_write(self._validator) as file:
                file.write(validator.encode("latin-1"))

    def finish(self) -> None:
        """Give the whole file its name."""
        with writing(self.path):
            with self.partial.open("rb") as file:
                os.fsync(file.fileno())
            os.replace(self.partial, self.path)
            self._validator.unlink(missing_ok=True)

    def discard(self) -> None:
        """Remove the part that is there."""
        with writing(self.partial):
            self._validator.unlink(missing_ok=True)
            self.partial.unlink(missing_ok=True)


def _file_name(url: str) -> str:
    """Return the last part of an address as a plain file name, never hidden and never empty."""
    last = unquote(urlsplit(url).path).rpartition("/")[2]
    return re.sub(r"[^A-Za-z0-9._-]", "_", last).lstrip(".")[-100:].lstrip(".") or "file"
