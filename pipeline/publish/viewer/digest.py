"""Files told apart by all their bytes."""

import hashlib
from pathlib import Path


def file_digest(path: Path) -> str:
    """Return a hash of a file's bytes, in a millisecond for each million of them.

    The digest that an Object File states would do for a sound one, but damage does not change it, and a
    file from elsewhere may state another's.

    Raises
    ------
    FileNotFoundError
        No such file.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
