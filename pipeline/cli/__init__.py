"""The `objectfolder` command: one module a group of commands, options and printing only.

Exit status: 0 fine; 1 an error that a user can act on, or a check whose answer is no; 2 wrong usage; 130
interrupted; 141 nobody reads the output any more, as after `| head`. An error is a line on standard error.
"""

import contextlib
import ctypes
import errno
import io
import os
import shutil
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from cyclopts import App, CycloptsError, Group, Parameter

import objectfolder
from objectfolder.errors import ObjectFolderError
from pipeline.cli import data_set_commands as data_set
from pipeline.cli import object_commands as objects
from pipeline.cli import publishing_commands as publishing
from pipeline.cli import sensor_commands as sensors
from pipeline.cli import table_commands as tables
from pipeline.cli import version_commands as versions
from pipeline.cli.examples import FIRST_STEPS, epilogue
from pipeline.cli.options import option_name
from pipeline.cli.printing import FAILED, FINE, print_error
from pipeline.cli.usage import UsageError, usage_line

USAGE, INTERRUPTED, UNREAD = 2, 130, 141
DVC_STAGE = "DVC_STAGE"  # DVC sets this for the commands of stages
PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG
OUTPUTS = ("-o", "--output", "--table", "--preview", "--data")
NO_SPACE, NO_DESCRIPTOR = (errno.ENOSPC, errno.EDQUOT), (errno.EMFILE, errno.ENFILE)
# Extras of pyproject.toml that have a package which `factory` lacks.
EXTRAS = {"av": "video", "boto3": "s3", "mujoco": "video", "pxr": "simulators", "xarray": "xarray"}
COMMANDS: dict[str, tuple[Callable[..., Any], ...]] = {
    "One object": (
        objects.build, objects.info, objects.sample, objects.render, objects.strike, objects.press,
        objects.modes, objects.fit_sound, objects.view,
    ),
    "Tables of objects": (tables.add, tables.check, tables.fetch),
    "Sensors": (sensors.calibrate,),
    "Data set": (data_set.select, data_set.partition, data_set.plan, data_set.status, data_set.clean),
    "Stages, as dvc.yaml runs them": (
        data_set.starter, data_set.code, data_set.inputs, data_set.products, data_set.record, data_set.stage,
        data_set.report, data_set.failures,
    ),
    "Versions": (versions.audit, versions.verify, versions.history),
    "Publishing": (
        publishing.cards, publishing.release, publishing.get, publishing.export, publishing.export_samples,
        publishing.gallery, publishing.scene, publishing.demo, publishing.play,
    ),
}  # fmt: skip


def application() -> App:
    """Return the command with all its sub-commands."""
    app = App(
        name="objectfolder",
        help="Make Object Files from meshes; ask them what an object looks, sounds and feels like.",
        help_format="markdown",
        help_epilogue=epilogue(*FIRST_STEPS),
        suppress_keyboard_interrupt=False,
        version=objectfolder.__version__,
        default_parameter=Parameter(negative=(), name_transform=option_name, show_default=_default_to_show),
    )
    for title, commands in COMMANDS.items():
        group = Group.create_ordered(title)
        for command in commands:
            app.command(command, group=group, help_epilogue=epilogue(command_name(command)))
    app.register_install_completion_command()
    return app


def command_name(function: Callable[..., Any]) -> str:
    """Return the name under which a function is called."""
    return function.__name__.replace("_", "-")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    _write_any_letter()
    try:
        with _ended_by_signals():
            status = application()(
                words,
                exit_on_error=False,
                print_error=False,
                result_action="return_value",
            )
            sys.stdout.flush()
        return int(status or FINE)
    except CycloptsError as error:
        print_error(usage_line(error))
        return USAGE
    except ObjectFolderError as error:
        print_error(error)
        if isinstance(error, UsageError) or error.where.startswith("--"):  # an option is at fault
            return USAGE
    except ModuleNotFoundError as error:
        print_error(_absent_package(words, error))
    except FileNotFoundError as error:
        if error.filename is None:  # Python finds no folder for temporary files
            print_error(f"{error.strerror}. Set TMPDIR to a folder that can be written and has space.")
        else:
            print_error(f"{error.filename}: no such file. Check the path.")
    except BrokenPipeError:
        # What is still buffered would fail again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except OSError as error:
        if error.errno in NO_SPACE:
            from pipeline.store.storage import disk_error

            # Of a copy, the second name is that of the copy.
            print_error(disk_error(error, Path(error.filename2 or error.filename or _fullest_folder(words))))
        elif error.errno in NO_DESCRIPTOR:
            print_error("too many files are open at once. Raise the limit: ulimit -n 1024.")
        elif error.filename is not None:
            print_error(f"{error.filename}: {error.strerror}. Check the path and its permissions.")
        else:
            raise
    except KeyboardInterrupt as error:  # with the command's words on what is kept (`on_interrupt`)
        print_error(f"interrupted. {error}".rstrip())
        return INTERRUPTED
    return FAILED


def _write_any_letter() -> None:
    """Let a terminal that has not all letters show the others escaped, and no command fail for a name."""
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def _fullest_folder(words: Sequence[str]) -> str:
    """Return the folder that is full where an error names none: of temporary files, of outputs, this one."""
    stated = [*pairwise(words), *(tuple(word.split("=", 1)) for word in words if "=" in word)]
    outputs = [Path(value).absolute() for option, value in stated if option in OUTPUTS]
    present = [str(next(path for path in (out, *out.parents) if path.is_dir())) for out in outputs]
    return min((tempfile.gettempdir(), *present, "."), key=lambda folder: shutil.disk_usage(folder).free)


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Let a terminal that closes, or a batch system that stops a run, end it as the keyboard does.

    So does the end of DVC for the command of a stage: DVC that is killed tells it nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, _interrupt) for number in (signal.SIGTERM, signal.SIGHUP)}
    if DVC_STAGE in os.environ:
        with contextlib.suppress(OSError, AttributeError):  # Linux only
            ctypes.CDLL(None).prctl(PARENT_DEATH_SIGNAL, signal.SIGTERM, 0, 0, 0)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _absent_package(words: Sequence[str], error: ModuleNotFoundError) -> str:
    """Return what to install for a command, or raise the error again where a module of ours is not there."""
    module = (error.name or "").partition(".")[0]
    if module in ("", "objectfolder", "pipeline"):
        raise error
    command, extra = words[0] if words else "", EXTRAS.get(module, "factory")
    return f'{command} needs {module}, which is not installed. pip install "objectfolder-factory[{extra}]"'


def _default_to_show(default: object) -> str | None:
    is_empty = default is None or default is False or default in ((), "")
    return None if is_empty else str(default)
