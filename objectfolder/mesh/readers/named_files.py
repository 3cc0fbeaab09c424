"""Files that a mesh or its material library names, found where they are and nowhere outside.

Meshes come from strangers: a name may be absolute, climb to other folders, differ in case or in the way
accents are written from what an archive unpacked to, or have the separators of another system.
"""

import os
import unicodedata
from collections.abc import Iterable
from pathlib import Path, PureWindowsPath


def find_file(folder: Path, names: Iterable[str], *, within: Path) -> Path | None:
    """Find the first of several names that is a file.

    Parameters
    ----------
    folder
        What relative names start from.
    names
        Each as written, with `/` or `\\` between folders.
    within
        Folder that the file must lie in, as its path is written; links inside it are followed.

    Returns
    -------
    Path or None
        None where there is no such file. A name that differs in case or in the form of accents (NFC, NFD)
        alone counts where it is the only one of its folder.
    """
    candidates = [folder / PureWindowsPath(name).as_posix() for name in names]
    inside = [path for path in candidates if lies_within(path, within)]
    for path in inside:
        if is_file(path):
            return path
    for path in inside:
        similar = _similar(path, within)
        if similar is not None:
            return similar
    return None


def is_file(path: Path) -> bool:
    """Whether there is a regular file; False for names that the system does not take."""
    try:
        return path.is_file()
    except OSError:
        return False


def lies_within(path: Path, folder: Path) -> bool:
    """Whether a path, as written, leads to something below a folder."""
    return Path(os.path.abspath(path)).is_relative_to(os.path.abspath(folder))


def _similar(path: Path, within: Path) -> Path | None:
    """The only file below `within` whose path differs from `path` in case and accents alone."""
    found = Path(os.path.abspath(within))
    for part in Path(os.path.abspath(path)).relative_to(found).parts:
        try:
            entries = os.listdir(found)
        except (OSError, ValueError):
            return None
        alike = [part] if part in entries else [entry for entry in entries if _key(entry) == _key(part)]
        if len(alike) != 1:
            return None
        found /= alike[0]
    return found if is_file(found) else None


def _key(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()
