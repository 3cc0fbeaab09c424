"""Names of an archive's members: which are paths inside a folder, on any machine, and which clash."""

import re
import unicodedata

LONGEST_PART_BYTES = 255
LONGEST_NAME = 1000
_DRIVE = re.compile(r"[A-Za-z]:")


def plain_name(name: str) -> str:
    """Return a member's path below its archive's folder, joined by ``/``; empty for the folder itself.

    Raises
    ------
    ValueError
        A name that leads elsewhere, or that not every file system can hold; it says which.
    """
    if name.startswith("/"):
        raise ValueError(f"{name!r} is an absolute path")
    if "\\" in name:
        raise ValueError(f"{name!r} has a backslash, which is a folder's border on some machines")
    if len(name) > LONGEST_NAME:
        raise ValueError(f"{name[:40]!r}... is a name of {len(name)} characters")
    if any(unicodedata.category(character) in ("Cc", "Cs") for character in name):
        raise ValueError(f"{name!r} has control characters, or is not UTF-8")
    parts = [part for part in name.split("/") if part not in ("", ".")]
    for part in parts:
        if part == "..":
            raise ValueError(f"{name!r} leads out of its folder")
        if _DRIVE.match(part):
            raise ValueError(f"{name!r} names a drive")
        if len(part.encode()) > LONGEST_PART_BYTES:
            raise ValueError(f"{name[:40]!r}... has a part of {len(part.encode())} bytes")
    return "/".join(parts)


class Names:
    """The names met so far, as a file system sees them that tells neither case nor composed letters apart."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[str, bool]] = {}

    def add(self, path: str, *, is_folder: bool) -> None:
        """Take note of a path that `plain_name` returned, and of the folders that it lies in.

        Raises
        ------
        ValueError
            A file that is there already, or a name that is another's but for case.
        """
        parts = path.split("/")
        for depth in range(1, len(parts)):
            self._add("/".join(parts[:depth]), is_folder=True)
        self._add(path, is_folder=is_folder)

    def _add(self, path: str, *, is_folder: bool) -> None:
        key = unicodedata.normalize("NFC", unicodedata.normalize("NFC", path).casefold())
        if key not in self._known:
            self._known[key] = path, is_folder
            return
        known, known_is_folder = self._known[key]
        if known != path:
            raise ValueError(f"{path!r} and {known!r} are one name where case is not told apart")
        if not (is_folder and known_is_folder):
            raise ValueError(f"{path!r} is there twice")
