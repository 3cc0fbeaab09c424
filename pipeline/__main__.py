"""``python -m pipeline COMMAND``: what ``dvc.yaml`` runs, and the few commands around it."""

import argparse
import errno
import importlib
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from objectfolder.errors import ObjectFolderError
from pipeline.cli.data_set_commands import COMMANDS
from pipeline.run import stage_run

PLACE = "OBJECTFOLDER_CLUSTER"

# Commands with options of their own, by the module that has them: `add_arguments` and `main`.
MODULES = {
    **COMMANDS,
    "scheduler": ("pipeline.cluster.scheduler", "run a scheduler that workers and drivers come to"),
    "worker": ("pipeline.cluster.worker", "work for a scheduler"),
}


def make_report(root: Path) -> int:
    """Import what the report needs only where it is made."""
    from pipeline.publish import data_set

    return data_set.make_report(root)


# What the stages of ``dvc.yaml`` run, beside those that make one kind of product.
STAGE_COMMANDS: dict[str, Callable[[Path], int]] = {
    "starter": stage_run.make_starter_set,
    "products": stage_run.make_products,
    "report": make_report,
    "failures": stage_run.show_failures,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command in the current folder; return its exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    root = Path.cwd()
    try:
        options = _parser(arguments[:1]).parse_args(arguments)
        if options.command in MODULES:
            module = importlib.import_module(MODULES[options.command][0])
            return int(module.main(options))
        if getattr(options, "cluster", None):
            os.environ[PLACE] = options.cluster
        if options.command == "select":
            return stage_run.select(root, options.objects, options.only)
        command = STAGE_COMMANDS.get(options.command) or partial(stage_run.make_stage, name=options.command)
        return command(root)
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


def _parser(chosen: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser; options of the module of the command `chosen` are read with it, no other's."""
    from pipeline.dataset.stages import STAGES

    parser = argparse.ArgumentParser(prog="python -m pipeline", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in ("starter", *STAGES, "report"):
        _where(commands.add_parser(name, help=f"run the stage {name}"))
    text = "run all stages that make products, with no barrier between them"
    _where(commands.add_parser("products", help=text, description=text))
    choose = commands.add_parser("select", help="choose objects in params.yaml")
    choose.add_argument("--objects", help="table of objects, a CSV file")
    choose.add_argument("--only", help="ids with commas between them; empty for all")
    commands.add_parser("failures", help="show which objects failed; exit 1 if any did")
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
