"""The command `listen`: a page for a listening test, truth against Object Files."""

import argparse
from pathlib import Path
from typing import Any

MOST_TRIALS = 500
LARGEST_SEED = 999_999_999  # what the page takes
SHORTEST_S, LONGEST_S = 0.05, 10.0


def add_commands(commands: Any) -> None:
    """Add the commands of this module to a parser's sub-commands."""
    text = "write a page for an ABX listening test: truth against Object Files at held-out points"
    command = commands.add_parser("listen", help=text, description=text)
    command.add_argument("root", nargs="?", default=".", help="root of a data set with modes (default: here)")
    command.add_argument("ids", nargs="*", metavar="ID", help="objects (default: all that are audible)")
    command.add_argument("-o", "--output", required=True, metavar="PAGE.html", help="the page")
    command.add_argument("--trials", type=int, default=24, help="number of trials (default 24)")
    command.add_argument("--seed", type=int, default=0, help="of the draw of strikes and trials (default 0)")
    command.add_argument("--duration", type=float, default=1.0, help="seconds of each sound (default 1)")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Write the page; say where it is."""
    from objectfolder.errors import InputError
    from pipeline.publish.listening.listening_page import write_page

    if not 1 <= options.trials <= MOST_TRIALS:
        raise InputError("--trials", f"{options.trials}", f"Give 1 to {MOST_TRIALS}.")
    if not 0 <= options.seed <= LARGEST_SEED:
        raise InputError("--seed", f"{options.seed}", f"Give 0 to {LARGEST_SEED}.")
    if not SHORTEST_S <= options.duration <= LONGEST_S:
        raise InputError("--duration", f"{options.duration} s", f"Give {SHORTEST_S} to {LONGEST_S} seconds.")
    path = Path(options.output)
    write_page(
        Path(options.root),
        path,
        trials=options.trials,
        seed=options.seed,
        objects=options.ids or None,
        duration_s=options.duration,
    )
    print(f"{path}  {path.stat().st_size / 1e6:.1f} MB, {options.trials} trials; open it in a browser")
