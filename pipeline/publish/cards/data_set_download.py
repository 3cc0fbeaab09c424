"""One file from a store to its name: resumed where it was left, checked, and never half there.

What has come is kept as ``.partial-<md5>-<name>`` beside the name; another call goes on after it. The
content of a name is whole: its MD5 is that of the published list, and its own checks hold.
"""

import fcntl
import hashlib
import os
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, InputError
from pipeline.dataset.products import verify
from pipeline.publish.cards.repository import Stores
from pipeline.store.storage import NO_SPACE

BLOCK = 2 << 20  # bytes of a request; a cut connection loses at most one
ATTEMPTS = 4
KEPT, FETCHED = "already there", "fetched"
Progress = Callable[[int], None]


def download(stores: Stores, md5: str, path: Path, progress: Progress = lambda count: None) -> str:
    """Bring content to `path`; return `KEPT` or `FETCHED`.

    Parameters
    ----------
    md5
        Of the content. A file that has it is kept; another of the name is replaced once all has come.
    progress
        Called with the number of new bytes as they come.

    Raises
    ------
    InputError
        No store has the content, its stores fail, or another process is fetching it to the same place.
    FormatError
        What a store has is not the content, or is damaged by the product's own checks.
    """
    if path.is_file() and _md5(path) == md5:
        return KEPT
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".partial-{md5}-{path.name}")
    # Without a buffer, which a full disk would make fail once more when it is closed.
    with partial.open("ab", buffering=0) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(str(path), "another process is fetching it", "Wait for it.") from error
        _fill(stores, md5, path, file, progress)
        try:
            verify(partial)
        except FormatError:
            partial.unlink()
            raise
        os.replace(partial, path)
    return FETCHED


def _fill(stores: Stores, md5: str, path: Path, file: FileIO, progress: Progress) -> None:
    """Append what is missing to `file`, from the first store that has it."""
    errors: list[str] = []
    found = False
    for name, odb in stores.sources:
        for attempt in range(ATTEMPTS):
            try:
                _append(odb.fs, odb.oid_to_path(md5), file, progress)
            except FileNotFoundError:
                break
            except InputError:
                raise
            except Exception as error:  # each kind of store has its own
                found = True
                errors.append(f"{name}: {type(error).__name__}: {error}".strip())
                continue
            found = True
            if _md5(Path(file.name)) == md5:
                file.flush()
                os.fsync(file.fileno())
                return
            errors.append(f"{name}: {file.tell()} bytes that are not {md5}")
            file.truncate(0)
            if attempt:  # once after a resumed part that may have been wrong, then no more
                break
    if not found:
        _discard_if_empty(file)
        raise stores.missing(str(path), md5)
    _discard_if_empty(file)
    raise FormatError(str(path), f"cannot be fetched ({errors[-1]})", "Try again: what has come is kept.")


def _append(fs: Any, source: str, file: FileIO, progress: Progress) -> None:
    """Append the bytes of `source` after those that `file` has, a range at a time."""
    size = fs.info(source)["size"]
    if size is None:
        raise OSError("its store does not say how large it is")
    place = file.seek(0, os.SEEK_END)
    if place > size:
        place = file.truncate(0)
    while place < size:
        wanted = min(BLOCK, size - place)
        block = fs.cat_file(source, start=place, end=place + wanted)
        if len(block) == size != wanted:  # a server without ranges sends all of it
            place = file.truncate(0)
        elif len(block) != wanted:
            raise ConnectionError(f"{len(block)} bytes came of {wanted} asked for")
        written = _written(block, file)
        place += written
        progress(written)


def _written(block: bytes, file: FileIO) -> int:
    """Write what fits of a block; a full disk is no fault of the store."""
    try:
        return file.write(block)
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        where = str(Path(file.name).parent)
        raise InputError(where, "no space is left", "Make room: what has come is kept.") from error


def _discard_if_empty(file: FileIO) -> None:
    file.flush()
    path = Path(file.name)
    if path.is_file() and path.stat().st_size == 0:
        path.unlink()


def _md5(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()
