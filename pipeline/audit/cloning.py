"""Clones of strangers' repositories, bounded in size, in number of files, and in how long nothing comes."""

import errno
import os
import subprocess
import time
from pathlib import Path

from objectfolder.child_process import last_words, module_command, search_path
from objectfolder.errors import InputError

LARGEST_CLONE_BYTES = 2**31
"""Products are not in git: a repository of a data set holds text, pictures and small meshes."""

MOST_FILES = 200_000
PATIENCE_S = 300.0
"""How long a server may send nothing."""

_INTERVAL_S = 0.1


def clone(address: str, folder: Path, branch: str | None = None) -> None:
    """Clone a repository into a new folder; of a branch or tag, without its history where the server can.

    Raises
    ------
    InputError
        It is larger than a repository of a data set is, or its server sends nothing.
    OSError
        The disk is full.
    dvc.scm.CloneError
        It cannot be cloned.
    """
    from dvc.scm import CloneError

    arguments = [address, str(folder), *([] if branch is None else [branch])]
    with subprocess.Popen(
        module_command("pipeline.audit.clone_process", *arguments),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        env={**os.environ, "PYTHONPATH": search_path()},
    ) as process:
        try:
            _watch(process, address, folder)
            words = process.communicate()[1]
        finally:
            process.kill()
    if process.returncode == errno.ENOSPC:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder))
    if process.returncode:
        raise CloneError(last_words(words))


def _watch(process: subprocess.Popen[str], address: str, folder: Path) -> None:
    """Wait until a clone has ended, or raise `InputError` where it goes beyond what is taken."""
    before, change_s = (0, 0), time.monotonic()
    is_over = False
    while not is_over:
        try:
            process.wait(_INTERVAL_S)
            is_over = True
        except subprocess.TimeoutExpired:
            pass
        size = bytes_and_files(folder)
        if size[0] > LARGEST_CLONE_BYTES or size[1] > MOST_FILES:
            most = f"{LARGEST_CLONE_BYTES / 1e9:.3g} GB or {MOST_FILES} files"
            raise InputError(
                address,
                f"is more than {most}, which no repository of a data set needs",
                "Look at who made it. If you trust it, clone it by git, and name the folder.",
            )
        if size != before:
            before, change_s = size, time.monotonic()
        elif time.monotonic() - change_s > PATIENCE_S:
            finding = f"its server has sent nothing for {PATIENCE_S:g} s"
            raise InputError(address, finding, "Try again later, or clone it by git, and name the folder.")


def bytes_and_files(folder: Path) -> tuple[int, int]:
    """Return the size of all that is below a folder that may be changing, and the number of its files."""
    size = count = 0
    pending = [str(folder)]
    while pending:
        try:
            with os.scandir(pending.pop()) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        pending.append(entry.path)
                    else:
                        size += entry.stat(follow_symlinks=False).st_size
                    count += 1
        except OSError:
            continue  # it was renamed or removed meanwhile
    return size, count
