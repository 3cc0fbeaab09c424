"""One run at a time on one checkout: a second waits and says for whom, or refuses.

The lock is the kernel's, on ``.objectfolder/run.lock``: it ends with its owner, however that ends, and
the file itself means nothing. It holds between processes of one machine; whether it does between machines
that share a disk depends on the file system (NFS since Linux 2.6.12 does, others may not), so one
checkout is for one driving machine.
"""

import contextlib
import fcntl
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, TextIO

from objectfolder.errors import InputError

WAIT = "OBJECTFOLDER_WAIT"
WITHIN = "OBJECTFOLDER_RUN"  # tells what a run starts, such as DVC and its stages, that it is part of it
REPEAT_S = 60.0  # between lines about waiting
LOOK_S = 0.1


@dataclass(frozen=True)
class Owner:
    """Who holds the lock.

    Parameters
    ----------
    pid
        Of the process.
    what
        What it runs.
    since
        When it began, local time without fractions.
    """

    pid: int
    what: str
    since: str

    def __str__(self) -> str:
        return f"process {self.pid}, which has run {self.what} since {self.since}"


@contextlib.contextmanager
def exclusive(root: Path, what: str, stream: TextIO | None = None) -> Iterator[None]:
    """Hold the checkout for a run, once no other run does; inside such a run, do nothing.

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
    most = most_seconds()
    outer = os.environ.get(WITHIN)
    holder = owner(root) if outer else None
    if holder is not None and str(holder.pid) == outer:
        yield
        return
    path = root / ".objectfolder" / "run.lock"
    path.parent.mkdir(parents=True, exist_ok=True)
    # Not truncated, for it names the owner; not inherited by programs started, or it outlives the run.
    with open(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644), "r+") as file:
        _acquire(file, root, most, stream or sys.stderr)
        _write_owner(file, Owner(os.getpid(), what, datetime.now().isoformat(" ", "seconds")))
        os.environ[WITHIN] = str(os.getpid())
        try:
            yield
        finally:
            os.environ.pop(WITHIN)
            if outer is not None:
                os.environ[WITHIN] = outer
            file.seek(0)
            file.truncate()


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
        seconds = -1.0
    if not seconds >= 0:
        raise InputError(
            WAIT, f"{text!r} is no number of seconds", "Give 0 to refuse at once, or leave it out."
        )
    return seconds


def owner(root: Path) -> Owner | None:
    """Return who holds a checkout now; None where nobody does."""
    path = root / ".objectfolder" / "run.lock"
    try:
        with path.open("r+") as file:
            named = _read_owner(file)
            return None if named is None or _locked(file) else named
    except FileNotFoundError:
        return None


def _acquire(file: IO[str], root: Path, most: float, stream: TextIO) -> None:
    begin = time.monotonic()
    said: tuple[Owner | None, float] | None = None
    while not _locked(file):
        now = time.monotonic()
        holder = _read_owner(file)
        if now - begin >= most:
            raise InputError(
                str(root),
                f"in use by {holder or 'another run'}",
                f"Wait for it, or end it (nothing finished is lost). Without {WAIT}=0 a run waits by itself.",
            )
        if holder and (said is None or said[0] != holder or now - said[1] > REPEAT_S):
            print(f"waiting for {holder}", file=stream, flush=True)
            said = holder, now
        time.sleep(LOOK_S)
    if said is not None:
        print(f"waited {time.monotonic() - begin:.0f} s", file=stream, flush=True)


def _locked(file: IO[str]) -> bool:
    """Take the lock if it is free."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _write_owner(file: IO[str], holder: Owner) -> None:
    file.seek(0)
    file.truncate()
    file.write(json.dumps(holder.__dict__))
    file.flush()


def _read_owner(file: IO[str]) -> Owner | None:
    """Return the owner that the file names; None for one that has not yet written itself."""
    file.seek(0)
    try:
        content = json.loads(file.read())
        return Owner(int(content["pid"]), str(content["what"]), str(content["since"]))
    except (ValueError, KeyError, TypeError):
        return None
