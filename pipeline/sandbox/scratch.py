"""Scratch folders of tasks, in one place, each named after the process that owns it.

``TMPDIR/objectfolder-UID/HOST~PID~START~RANDOM``: an owner that was killed removes nothing, but its name
tells that it is dead, and the next run (or ``clean``) does.
"""

import os
import shutil
import socket
import tempfile
from pathlib import Path

from pipeline.sandbox.process_tree import end_with_variable
from pipeline.store.storage import own_folder

SEPARATOR = "~"
KEYS = Path(".objectfolder/keys")  # of batch jobs, below the root of a data set, for all its machines


class Scratch(tempfile.TemporaryDirectory[str]):
    """A folder that is removed with this object, or when the process ends; its name has a word in it."""

    def __init__(self, kind: str = "task", folder: Path | None = None) -> None:
        owner = (socket.gethostname(), str(os.getpid()), _start_of(os.getpid()), f"{kind}-")
        place = folder or home()
        super().__init__(prefix=SEPARATOR.join(owner), dir=place, ignore_cleanup_errors=True)


def home() -> Path:
    """Return the folder of all scratch folders of this user, made if absent.

    Raises
    ------
    InputError
        It belongs to somebody else.
    """
    return own_folder(Path(tempfile.gettempdir()) / f"objectfolder-{os.getuid()}", "TMPDIR")


def abandoned(folder: Path | None = None) -> list[Path]:
    """Return the scratch folders in a folder (default: `home`) whose owner, of this host, is dead."""
    folders = (path for path in (folder or home()).glob("*") if path.is_dir() and not path.is_symlink())
    return sorted(path for path in folders if _owner_is_dead(path.name))


def sweep(folder: Path | None = None) -> list[Path]:
    """Remove the folders of dead owners, and return them; processes that still work there end."""
    folders = abandoned(folder)
    for path in folders:
        end_with_variable("TMPDIR", str(path))
        shutil.rmtree(path, ignore_errors=True)
    return folders


def _owner_is_dead(name: str) -> bool:
    """Whether a scratch folder's owner was a process of this host and is no more."""
    host, pid, start, *_ = (*name.split(SEPARATOR), "", "")
    return host == socket.gethostname() and pid.isdecimal() and _start_of(int(pid)) != start


def _start_of(pid: int) -> str:
    """Return the start time of a process, as text; empty for an ended one."""
    import psutil

    try:
        process = psutil.Process(pid)
        return "" if process.status() == psutil.STATUS_ZOMBIE else f"{process.create_time():.2f}"
    except psutil.NoSuchProcess:
        return ""
