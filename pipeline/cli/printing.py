"""Output that commands share: errors, results, a status line on the terminal, and how a page ends."""

import contextlib
import json as json_text
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, NoReturn

from objectfolder.errors import printable

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

FINE, FAILED = 0, 1
QUIET_S = 3.0  # of a command whose output is no terminal
RESUMED = "What is finished is kept; the same command does the rest."
REPEATED = "Nothing is kept; the same command begins anew."
Show = Callable[[str], None]


def print_error(error: object) -> None:
    """Print an error on standard error, in a line."""
    print(f"objectfolder: {printable(error)}", file=sys.stderr)


def print_text(text: object) -> None:
    """Print a text for people at once; what a terminal would obey is replaced."""
    print(printable(text), flush=True)


def print_result(result: "DataclassInstance", *, json: bool) -> None:
    """Print a result on standard output, in words or as JSON."""
    print(json_text.dumps(asdict(result), indent=1) if json else printable(result))


def terminal_width(otherwise: int = 100) -> int:
    """Return the columns of the terminal."""
    return shutil.get_terminal_size((otherwise, 24)).columns


@contextlib.contextmanager
def status_line(line: str) -> Iterator[Show]:
    """Show on standard error what is done until the block ends; yield a function that replaces the line.

    A log has a line after `QUIET_S`, and then every 30 s.
    """
    from pipeline.run.display import Display

    lines = [line]
    with Display(lambda: lines[-1], delay_s=QUIET_S):
        yield lambda new: lines.__setitem__(-1, new)


@contextlib.contextmanager
def on_interrupt(words: str) -> Iterator[None]:
    """Say these words if the block is interrupted."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(words) from None


def end_at_once() -> NoReturn:
    """End the command behind a page.

    Code may still be compiled, or an image computed, in a thread that nothing can stop and that Python would
    wait for. No result is awaited any more, and no file is left to be written.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
