"""Reads of regular files alone: a named pipe would wait for a writer, and a device may have no end."""

import errno
import os
import stat
from io import BufferedReader
from pathlib import Path

_NAMES = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
}
_AT_ONCE = getattr(os, "O_NONBLOCK", 0)  # of POSIX: opening a pipe does not wait


def irregular(mode: int) -> str:
    """Return what a file is by the mode of its status, as "a named pipe"; empty where it is a regular one."""
    return "" if stat.S_ISREG(mode) else _NAMES.get(stat.S_IFMT(mode), "of no known kind")


def require_regular(path: Path | str) -> None:
    """Raise OSError unless a path leads to a regular file; links are followed."""
    _check(path, os.stat(path))


def open_regular(path: Path | str) -> BufferedReader:
    """Open a regular file to read its bytes; links are followed.

    Raises
    ------
    OSError
        It cannot be opened, or is a folder, a named pipe, a socket or a device.
    """
    require_regular(path)  # first: opening a device can do something
    return open(path, "rb", opener=_open_at_once)


def read_regular(path: Path | str) -> bytes:
    """Return the bytes of a regular file; raises as `open_regular` does."""
    with open_regular(path) as file:
        return file.read()


def _open_at_once(path: str, flags: int) -> int:
    descriptor = os.open(path, flags | _AT_ONCE)
    try:
        _check(path, os.fstat(descriptor))  # what was opened may be another file
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def _check(path: Path | str, status: os.stat_result) -> None:
    if kind := irregular(status.st_mode):
        number = errno.EISDIR if stat.S_ISDIR(status.st_mode) else errno.EINVAL
        raise OSError(number, f"is {kind}, not a file", str(path))
