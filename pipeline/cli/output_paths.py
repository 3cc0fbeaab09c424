"""Files and folders that results are written to: new, or replaced where that is asked for."""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

from objectfolder.errors import InputError

# Files that sample, render, strike and press write.
ANSWER = re.compile(
    r"\d{4,}(_[a-z]+)?\.(png|npy|wav)|turntable\.gif|(views|points|forces|depth)\.npy|labels\.json"
)


def check_new_file(path: Path, *, overwrite: bool) -> None:
    """Refuse a file that is there already.

    Parameters
    ----------
    path
        A file to write.
    overwrite
        It may be replaced.

    Raises
    ------
    InputError
        A folder, or a file that may not be replaced.
    """
    if path.is_dir():
        raise InputError(str(path), "is a folder", "Name a file.")
    if path.exists() and not overwrite:
        raise InputError(str(path), "is there already", "Name another file, or give --overwrite.")


@contextlib.contextmanager
def answers_folder(path: Path, *, overwrite: bool) -> Iterator[None]:
    """Let a block write answers to a folder, without those of another run among them.

    Parameters
    ----------
    path
        A folder that does not exist, or is empty.
    overwrite
        Replace the answers that are there. Those that the block did not write again are removed when it ends
        without an error.

    Raises
    ------
    InputError
        A file, answers that may not be replaced, or a folder with other files.
    """
    if path.exists() and not path.is_dir():
        raise InputError(str(path), "is a file", "Name a folder that does not exist yet.")
    before = {file: file.stat().st_mtime_ns for file in path.iterdir()} if path.is_dir() else {}
    foreign = [file.name for file in before if not ANSWER.fullmatch(file.name)]
    if foreign:
        raise InputError(str(path), f"holds {min(foreign)}, which no query wrote", "Name another folder.")
    if before and not overwrite:
        raise InputError(
            str(path), "holds answers of another run", "Name another folder, or give --overwrite."
        )
    yield
    for file, time in before.items():
        if file.stat().st_mtime_ns == time:  # not written again
            file.unlink()
