"""One run at a time on one checkout: a second run names the first and waits, or refuses.

The lock on ``.objectfolder/run.lock`` is the kernel's and ends with its owner, however that ends. Who the
owner is stands beside it. It holds between processes of one machine; whether it does between machines that
share a disk depends on the file system, so one checkout is for one driving machine.
"""

import contextlib
import math
import os
import sys
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import TextIO

from filelock import FileLock, Timeout

from objectfolder.errors import InputError
from pipeline.dataset.project_files import DASHBOARD
from pipeline.dataset.validation import number_of

WAIT = "OBJECTFOLDER_WAIT"


@contextlib.contextmanager
def exclusive(root: Path, what: str, stream: TextIO | None = None) -> Iterator[None]:
    """Lock the checkout for a run, once no other run has it; `what` runs is said to those who wait.

    Raises
    ------
    InputError
        Another run holds the checkout, and ``OBJECTFOLDER_WAIT`` is 0 or that many seconds went by; or
        it is no number.
    """
    lock, owner_path = _lock(root), _owner_file(root)
    owner_path.parent.mkdir(parents=True, exist_ok=True)
    most_s = number_of(WAIT, math.inf)
    if most_s and (process := owner(root)):
        print(f"waiting for {process}", file=stream or sys.stderr, flush=True)
    try:
        lock.acquire(timeout=most_s)
    except Timeout as error:
        remedy = f"Wait for it, or end it (nothing finished is lost). Without {WAIT}=0 a run waits by itself."
        raise InputError(str(root), f"in use by {_named(root)}", remedy) from error
    try:
        (root / DASHBOARD).unlink(missing_ok=True)  # of a run that was killed
        since = datetime.now().isoformat(" ", "seconds")
        owner_path.write_text(f"process {os.getpid()}, which has run {what} since {since}")
        yield
    finally:
        owner_path.unlink(missing_ok=True)
        lock.release()


def owner(root: Path) -> str | None:
    """Return which process holds a checkout now, what it runs and since when; None where no process does."""
    if not _owner_file(root).exists():
        return None
    try:
        with _lock(root).acquire(timeout=0):
            return None
    except Timeout:
        return _named(root)


def _lock(root: Path) -> FileLock:
    return FileLock(root / ".objectfolder" / "run.lock", thread_local=False)


def _owner_file(root: Path) -> Path:
    return root / ".objectfolder" / "run.owner"


def _named(root: Path) -> str:
    """Return who holds a checkout, and where its dashboard is."""
    words = []
    for path in (_owner_file(root), root / DASHBOARD):
        with contextlib.suppress(FileNotFoundError):  # it has just begun, or ended
            words.append(path.read_text())
    return ", dashboard ".join(words) or "another run"
