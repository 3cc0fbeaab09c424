"""The `objectfolder` command: one module a group of commands, options and printing only.

Exit status: 0 fine; 1 an error that a user can act on, or a check whose answer is no; 2 wrong usage; 130
interrupted. An error is a line on standard error.
"""

import contextlib
import errno
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from cyclopts import App, CycloptsError, Group, Parameter

import objectfolder
from objectfolder.errors import ObjectFolderError
from pipeline.cli import (
    cluster_commands,
    data_set_commands,
    object_commands,
    publishing_commands,
    table_commands,
    version_commands,
)
from pipeline.cli.options import option_name
from pipeline.cli.printing import FAILED, FINE, print_error

USAGE, INTERRUPTED = 2, 130
NO_SPACE = (errno.ENOSPC, errno.EDQUOT)
EPILOG = """Examples:

```
objectfolder build mug.obj --material ceramic --length 0.16 -o mug.safetensors
objectfolder info mug.safetensors
objectfolder sample mug.safetensors --views 8 --contacts 8 --seed 0 -o queries
objectfolder render mug.safetensors --views queries/views.npy -o images
objectfolder strike mug.safetensors --points queries/points.npy --forces queries/forces.npy -o sounds
objectfolder press mug.safetensors --points queries/points.npy --depth 0.001 -o touches
objectfolder modes mug.obj --material ceramic --max-frequency 20000 --json
objectfolder fetch ycb:025_mug gso:ACE_Coffee_Mug_Kristen_16_oz_cup
objectfolder export mug --format nerf -o mug-nerf
objectfolder plan --count 1000 --workers 2 64
```
"""
COMMANDS: dict[str, tuple[Callable[..., Any], ...]] = {
    "One object": (
        object_commands.build,
        object_commands.info,
        object_commands.sample,
        object_commands.render,
        object_commands.strike,
        object_commands.press,
        object_commands.modes,
        object_commands.view,
    ),
    "Tables of objects": (table_commands.add, table_commands.check, table_commands.fetch),
    "Data set": (
        data_set_commands.select,
        data_set_commands.plan,
        data_set_commands.status,
        data_set_commands.clean,
    ),
    "Stages, as dvc.yaml runs them": (
        data_set_commands.starter,
        data_set_commands.products,
        data_set_commands.stage,
        data_set_commands.report,
        data_set_commands.failures,
    ),
    "Machines": (cluster_commands.scheduler, cluster_commands.worker),
    "Versions": (version_commands.audit, version_commands.verify, version_commands.history),
    "Publishing": (
        publishing_commands.cards,
        publishing_commands.get,
        publishing_commands.export,
        publishing_commands.listen,
    ),
}


def application() -> App:
    """Return the command with all its sub-commands."""
    app = App(
        name="objectfolder",
        help="Make Object Files from meshes; ask them what an object looks, sounds and feels like.",
        help_format="markdown",
        help_epilogue=EPILOG,
        suppress_keyboard_interrupt=False,
        version=objectfolder.__version__,
        default_parameter=Parameter(negative=(), name_transform=option_name, show_default=_default_to_show),
    )
    for title, commands in COMMANDS.items():
        group = Group.create_ordered(title)
        for command in commands:
            app.command(command, group=group, help_epilogue="")
    app.register_install_completion_command()
    return app


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit status."""
    try:
        with _ended_by_signals():
            status = application()(
                list(sys.argv[1:] if arguments is None else arguments),
                exit_on_error=False,
                print_error=False,
                result_action="return_value",
            )
        return int(status or FINE)
    except CycloptsError as error:
        print_error(f"{error} See objectfolder --help.")
        return USAGE
    except ObjectFolderError as error:
        print_error(error)
    except FileNotFoundError as error:
        print_error(f"{error.filename}: no such file. Check the path.")
    except OSError as error:
        if error.errno in NO_SPACE:
            from pipeline.store.storage import disk_error

            print_error(disk_error(error, Path(error.filename or ".")))
        elif error.filename is not None:
            print_error(f"{error.filename}: {error.strerror}. Check the path, and whom it belongs to.")
        else:
            raise
    except KeyboardInterrupt:
        print_error("interrupted. What is finished is kept; the same command does the rest.")
        return INTERRUPTED
    return FAILED


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Let a terminal that closes, or a batch system that stops a run, end it as the keyboard does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, _interrupt) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _default_to_show(default: object) -> str | None:
    is_empty = default is None or default is False or default in ((), "")
    return None if is_empty else str(default)
