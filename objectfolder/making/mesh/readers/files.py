"""Files of a mesh: found where their names say and nowhere outside, read in whatever encoding they have.

A name may be absolute, climb to other folders, differ in case or in the way accents are written from what an
archive unpacked to, or have the separators of another system.
"""

import codecs
import os
import re
import unicodedata
from collections.abc import Iterable
from pathlib import Path, PureWindowsPath

import numpy as np

from objectfolder.errors import InputError
from objectfolder.products.regular_file import read_regular

LARGEST_FILE_BYTES = 2**29
"""Of a mesh or an image; a larger one would not fit the memory of one task once it is read."""

LARGEST_TEXT_BYTES = 2**28
"""Of a mesh as text, some six million triangles; numbers take ten times their text while they are read."""

LARGEST_FILE_NUMBER = 1e15
"""Of a coordinate, in the file's own units: micrometres on the Moon have less."""

SMALLEST_EXTENT = 1e-15
"""Of the longest side, in the file's own units."""

LEAST_STEPS = 1000
"""Along the longest side, of positions stored in single precision."""

_COMMENT = re.compile(r"(?:^|\s)#")
_CONTINUED = re.compile(r"\\[ \t]*\n")


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


def usual_places(name: str) -> list[str]:
    """Return where a picture may be: as written, with or without quotes, or by its own name beside a mesh.

    A name may be absolute, of another system too, and scans come with a folder of textures.
    """
    written = [name, unquoted(name)]
    base = PureWindowsPath(written[1]).name
    return list(dict.fromkeys([*written, base, f"textures/{base}"]))


def unquoted(name: str) -> str:
    """Return a name without quotes around it."""
    return name[1:-1] if len(name) > 2 and name[0] == name[-1] and name[0] in "\"'" else name


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
    candidate = Path(os.path.abspath(within))
    for part in Path(os.path.abspath(path)).relative_to(candidate).parts:
        try:
            entries = os.listdir(candidate)
        except (OSError, ValueError):
            return None
        alike = [part] if part in entries else [entry for entry in entries if _key(entry) == _key(part)]
        if len(alike) != 1:
            return None
        candidate /= alike[0]
    return candidate if is_file(candidate) else None


def _key(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()


def read_bytes(path: Path, most: int = LARGEST_FILE_BYTES) -> bytes:
    """Read a file whole, of at most `most` bytes.

    Raises
    ------
    InputError
        It cannot be read, or is too large to be a mesh or an image.
    """
    try:
        size = path.stat().st_size
        if size > most:
            raise InputError(
                str(path),
                f"has {size} bytes, more than the {most} that are read",
                "Reduce its number of triangles or texels",
            )
        return read_regular(path)
    except OSError as problem:
        raise InputError(str(path), f"cannot be read ({problem.strerror})", "Correct the path") from problem


def read_text(path: Path) -> str:
    r"""Text of a file in UTF-8, in UTF-16 with its mark, or else in Latin-1, with `\n` as the end of lines.

    A byte order mark is left out. Latin-1 gives every byte a letter, so that names stay distinct.
    """
    data = read_bytes(path, LARGEST_TEXT_BYTES)
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def joined_lines(text: str) -> list[str]:
    r"""Lines of a text in which a `\` at the end of one continues it on the next."""
    return _CONTINUED.sub(" ", text).split("\n")


def without_comment(text: str) -> str:
    """What stands before a comment: a `#` at the start or after a space, for names may hold others."""
    return _COMMENT.split(text, maxsplit=1)[0].strip() if "#" in text else text.strip()


def unreadable(path: Path, kind: str, problem: Exception) -> InputError:
    """What is said of a mesh file that is not of its kind, or is not whole."""
    reason = f"it has no {problem}" if isinstance(problem, KeyError) else problem
    return InputError(
        str(path),
        f"cannot be read as {kind} ({brief(reason)})",
        "Check that the file is complete and what it says",
    )


def brief(problem: object) -> str:
    """Return what a problem says on one line, not whole where it is long: it may quote the file."""
    text = " ".join(str(problem).split())
    return text if len(text) <= 200 else f"{text[:197]}..."


def shortened(text: str) -> str:
    """Quote what a file says, as an error may: on one line and not whole where it is long."""
    return repr(text if len(text) <= 80 else f"{text[:77]}...")


def refuse_unusable(path: Path, vertices: np.ndarray) -> None:
    """Raise `InputError` for positions (V, 3) that are not finite, or of no size that measures can take."""
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise InputError(
            str(path),
            f"{len(bad)} of {len(vertices)} vertices are not finite (the first is vertex {bad[0] + 1})",
            "Repair the mesh: NaN and infinite coordinates have no place",
        )
    if not len(vertices):
        return
    largest = float(np.abs(vertices).max())
    if largest > LARGEST_FILE_NUMBER:
        raise InputError(
            str(path),
            f"has a coordinate of {largest:g}, which no unit of length explains",
            "Repair the mesh: stray vertices far away are a fault of the export",
        )
    extent = float(np.ptp(vertices, axis=0).max())
    if 0 < extent < SMALLEST_EXTENT:
        raise InputError(str(path), f"is {extent:g} long in its own unit", "Export the mesh again, in metres")


def single_precision_step(vertices: np.ndarray) -> float:
    """Distance between neighbouring float32 numbers at the coordinate farthest from the origin."""
    return float(np.spacing(np.float32(np.abs(vertices).max()))) if len(vertices) else 0.0


def refuse_coarse(path: Path, vertices: np.ndarray, step: float) -> None:
    """Raise `InputError` where positions (V, 3), stored in steps of `step`, show little of the shape."""
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    if extent > 0 and step * LEAST_STEPS > extent:
        raise InputError(
            str(path),
            f"is {extent:g} long but lies so far from the origin that its coordinates, stored in single "
            f"precision, have steps of {step:g}",
            "Move the mesh to the origin before it is exported",
        )
