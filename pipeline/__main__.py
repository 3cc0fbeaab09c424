"""``python -m pipeline COMMAND``: what ``dvc.yaml`` runs, and the few commands around it."""

import argparse
import errno
import importlib
import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from objectfolder.errors import ObjectFolderError
from pipeline.cli.data_set_commands import COMMANDS

PARAMETERS = "params.yaml"
STARTER = "data/starter"
REPORTS = "reports"
PLACE = "OBJECTFOLDER_CLUSTER"

STAGE_NAMES = ("objects", "views", "modes", "touches", "encode", "fidelity")
# Commands with options of their own, by the module that has them: `add_arguments` and `main`.
MODULES = {
    **COMMANDS,
    "scheduler": ("pipeline.cluster.scheduler", "run a scheduler that workers and drivers come to"),
    "worker": ("pipeline.cluster.worker", "work for a scheduler"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command in the current folder; return its exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    options = _parser(arguments[:1]).parse_args(arguments)
    root = Path.cwd()
    try:
        if options.command in MODULES:
            module = importlib.import_module(MODULES[options.command][0])
            return int(module.main(options))
        if getattr(options, "cluster", None):
            os.environ[PLACE] = options.cluster
        if options.command == "select":
            return select(root, options.objects, options.only)
        if options.command == "failures":
            return show_failures(root)
        return _run(root, options.command)
    except ObjectFolderError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        from pipeline.store.storage import disk_error

        print(f"error: {disk_error(error, Path(error.filename or root))}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted: nothing finished is lost, the next run does what is left", file=sys.stderr)
        return 130


def _run(root: Path, command: str) -> int:
    """Run what changes the data set, one at a time."""
    from pipeline.dataset.stages import STAGES
    from pipeline.publish.data_set import make_dataset, make_report
    from pipeline.run.stage_run import converge_stages, data_set_run

    # A terminal that closes, or a batch system that stops a run, ends it as the keyboard does.
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _interrupted)
    names = {"products": "all products", "dataset": "the data set"}
    with data_set_run(root, names.get(command, f"stage {command}")):
        if command == "starter":
            return make_starter_set(root)
        if command == "report":
            make_report(root)
            return 0
        if command == "dataset":
            code = make_dataset(root)
            failed = show_failures(root)
            if code == 0:
                print(f"Object Files: data/object_files/\nReport:       {REPORTS}/index.html")
            return code or failed
        return converge_stages(root, tuple(STAGES) if command == "products" else [command])


def _interrupted(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def select(root: Path, objects: str | None, only: str | None) -> int:
    """Choose objects in ``params.yaml``; say what changed."""
    from pipeline.dataset import selection

    print("\n".join(selection.select(root / PARAMETERS, objects, only)))
    return 0


def make_starter_set(root: Path) -> int:
    """Write the meshes and textures of the starter set."""
    from objectfolder.geometry.starter.write import write_starter_set

    write_starter_set(root / STARTER)
    return 0


def show_failures(root: Path) -> int:
    """Print what failed in the last run of each stage; return 1 if anything did."""
    from pipeline.run.failure_table import failure_table
    from pipeline.run.stage_run import all_failures

    failures = [replace(failure, error=f"{stage}: {failure.error}") for stage, failure in all_failures(root)]
    if failures:
        print(failure_table(failures))
    return 1 if failures else 0


def _parser(chosen: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser; options of the module of the command `chosen` are read with it, no other's."""
    parser = argparse.ArgumentParser(prog="python -m pipeline", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in ("starter", *STAGE_NAMES, "report"):
        _where(commands.add_parser(name, help=f"run the stage {name}"))
    text = "run all stages that make products, with no barrier between them"
    _where(commands.add_parser("products", help=text, description=text))
    text = "make all products, run dvc repro, try failed objects again, say where the report is"
    _where(commands.add_parser("dataset", help=text, description=text))
    choose = commands.add_parser("select", help="choose objects in params.yaml")
    choose.add_argument("--objects", help="table of objects, a CSV file")
    choose.add_argument("--only", help="ids with commas between them; empty for all")
    commands.add_parser("failures", help="show what failed in the last runs; exit 1 if any did")
    for name, (module, text) in MODULES.items():
        command = commands.add_parser(name, help=text, description=text)
        if [name] == list(chosen):
            importlib.import_module(module).add_arguments(command)
    return parser


def _where(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--cluster",
        metavar="PLACE",
        help=f"a name in cluster/, a YAML file or the address of a scheduler (default: {PLACE}, or local)",
    )


if __name__ == "__main__":
    sys.exit(main())
