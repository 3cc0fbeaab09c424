"""Output that commands share: errors, a status line on the terminal, and how a page ends."""

import contextlib
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from typing import NoReturn

FINE, FAILED = 0, 1
Show = Callable[[str], None]


def print_error(error: object) -> None:
    """Print an error on standard error, in a line."""
    print(f"objectfolder: {error}", file=sys.stderr)


def terminal_width(otherwise: int = 100) -> int:
    """Return the columns of the terminal."""
    return shutil.get_terminal_size((otherwise, 24)).columns


@contextlib.contextmanager
def status_line() -> Iterator[Show]:
    """Yield a function that replaces the status line on the terminal; without a terminal it does nothing."""
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True).status("") as status:
        yield lambda line: status.update(Text(line))


def end_at_once() -> NoReturn:
    """End the command behind a page.

    Code may still be compiled, or an image computed, in a thread that nothing can stop and that Python would
    wait for. No result is awaited any more, and no file is left to be written.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
