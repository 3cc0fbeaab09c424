"""One run at a time on one checkout: a second run names the first and waits, or refuses.

The lock on ``.objectfolder/run.lock`` is the kernel's and ends with its owner, however that ends. Who the
owner is stands beside it. It holds between processes of one machine; whether it does between machines that
share a disk depends on the file system, so one checkout is for one driving machine.
"""

import contextlib
import math
import os
import sys
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import TextIO

from filelock import FileLock, Timeout

from objectfolder.errors import InputError
from pipeline.dataset.run_id import RUN_ID, new_run_id

WAIT = "OBJECTFOLDER_WAIT"
REPEAT_S = 60.0  # between lines about waiting


@contextlib.contextmanager
def running(root: Path, what: str) -> Iterator[None]:
    """Run something that changes the data set: no other run beside it, and with an id.

    Raises
    ------
    InputError
        As `exclusive`.
    """
    os.environ[RUN_ID] = new_run_id()
    with exclusive(root, what):
        yield


@contextlib.contextmanager
def exclusive(root: Path, what: str, stream: TextIO | None = None) -> Iterator[None]:
    """Lock the checkout for a run, once no other run has it.

    Parameters
    ----------
    root
        Root of the data set.
    what
        What runs, for those who wait.
    stream
        Where it says that it waits; standard error by default.

    Raises
    ------
    InputError
        Another run holds the checkout, and ``OBJECTFOLDER_WAIT`` is 0 or as many seconds went by.
    """
    lock, named = _lock(root), _owner_file(root)
    named.parent.mkdir(parents=True, exist_ok=True)
    _acquire(lock, root, most_seconds(), stream or sys.stderr)
    try:
        since = datetime.now().isoformat(" ", "seconds")
        named.write_text(f"process {os.getpid()}, which has run {what} since {since}")
        yield
    finally:
        named.unlink(missing_ok=True)
        lock.release()


def most_seconds() -> float:
    """Return how long to wait for another run, from ``OBJECTFOLDER_WAIT``: without end by default.

    Raises
    ------
    InputError
        It is no number of seconds.
    """
    text = os.environ.get(WAIT, "inf")
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not seconds >= 0:
        raise InputError(
            WAIT, f"{text!r} is no number of seconds", "Give 0 to refuse at once, or leave it out."
        )
    return seconds


def owner(root: Path) -> str | None:
    """Return which process holds a checkout now, what it runs and since when; None where no process does."""
    if not _owner_file(root).exists():
        return None
    try:
        with _lock(root).acquire(timeout=0):
            return None
    except Timeout:
        return _named(root)


def _acquire(lock: FileLock, root: Path, most: float, stream: TextIO) -> None:
    begin = time.monotonic()
    pause = 0.0
    while True:
        with contextlib.suppress(Timeout):
            lock.acquire(timeout=pause)
            break
        holder = _named(root)
        left = most - (time.monotonic() - begin)
        if left <= 0:
            remedy = (
                f"Wait for it, or end it (nothing finished is lost). Without {WAIT}=0 a run waits by itself."
            )
            raise InputError(str(root), f"in use by {holder}", remedy)
        print(f"waiting for {holder}", file=stream, flush=True)
        pause = min(REPEAT_S, left)
    if pause:
        print(f"waited {time.monotonic() - begin:.0f} s", file=stream, flush=True)


def _lock(root: Path) -> FileLock:
    return FileLock(root / ".objectfolder" / "run.lock", thread_local=False)


def _owner_file(root: Path) -> Path:
    return root / ".objectfolder" / "run.owner"


def _named(root: Path) -> str:
    try:
        return _owner_file(root).read_text() or "another run"
    except FileNotFoundError:  # it has just begun, or ended
        return "another run"
