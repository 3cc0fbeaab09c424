"""The `objectfolder` command."""

import argparse
import sys
from collections.abc import Sequence

from objectfolder.errors import ObjectFolderError
from pipeline.cli import (
    add,
    audit,
    build,
    cards,
    check,
    data_set_commands,
    export,
    fetch,
    get,
    listen,
    query,
    solve,
    view,
)
from pipeline.cli.intermixed import IntermixedParser

EPILOG = """examples:
  objectfolder build mug.obj --material ceramic --length 0.16 -o mug.safetensors
  objectfolder info mug.safetensors
  objectfolder sample mug.safetensors --views 8 --contacts 8 --seed 0 -o queries
  objectfolder render mug.safetensors --views queries/views.npy -o images
  objectfolder strike mug.safetensors --points queries/points.npy --forces queries/forces.npy -o sounds
  objectfolder press mug.safetensors --points queries/points.npy --depth 0.001 -o touches
  objectfolder modes mug.obj --material ceramic --max-frequency 20000 --json
  objectfolder export mug --format nerf -o mug-nerf
  objectfolder plan --count 1000 --workers 2 64
"""


def parser(chosen: Sequence[str] = ()) -> argparse.ArgumentParser:
    """Return the parser of all sub-commands; `chosen` is the one to be run."""
    main_parser = argparse.ArgumentParser(
        prog="objectfolder",
        description="Make Object Files from meshes; ask them what an object looks, sounds and feels like.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = main_parser.add_subparsers(
        title="commands", required=True, metavar="COMMAND", parser_class=IntermixedParser
    )
    for module in (build, add, solve, query, export, audit, cards, check, fetch, get, listen, view):
        module.add_commands(commands)
    data_set_commands.add_commands(commands, chosen)
    return main_parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit status, 1 with one line on stderr for an error a user can act on."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    options = parser(arguments[:1]).parse_args(arguments)
    try:
        return int(options.run(options) or 0)
    except ObjectFolderError as error:
        print(f"objectfolder: {error}", file=sys.stderr)
        return 1
    except FileNotFoundError as error:
        print(f"objectfolder: {error.filename}: no such file. Check the path.", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
