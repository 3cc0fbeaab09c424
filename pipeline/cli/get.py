"""The command `get`: single objects of a published data set."""

import argparse
import sys
from pathlib import Path
from typing import Any


def add_commands(commands: Any) -> None:
    """Add the commands of this module to a parser's sub-commands."""
    text = "fetch single objects of a published data set: only what is missing, checked"
    command = commands.add_parser("get", help=text, description=text)
    command.add_argument("repository", metavar="REPO[@REV]", help="path or URL of a git repository under DVC")
    command.add_argument("ids", nargs="*", metavar="ID", help="objects (default: all of them)")
    command.add_argument(
        "-o", "--output", default=".", metavar="FOLDER", help="where they come (default: here)"
    )
    command.add_argument(
        "--stage",
        action="append",
        default=[],
        metavar="NAME",
        help="products in place of Object Files, to FOLDER/data/NAME: object_files, objects, views, modes, "
        "touches or fidelity; may be given again",
    )
    command.add_argument(
        "--list", action="store_true", help="print the ids that can be fetched, and fetch nothing"
    )
    command.add_argument(
        "--remote", default="", metavar="NAME", help="DVC remote (default: the repository's)"
    )
    command.add_argument("--jobs", type=int, default=4, help="files at a time (default 4)")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Fetch; a line an object, and 1 if any failed."""
    from pipeline.publish.cards.published_revision import split_revision
    from pipeline.publish.cards.single_objects import Got, get, known_ids

    repository, revision = split_revision(options.repository)
    if options.list:
        print("\n".join(known_ids(repository, revision=revision, remote=options.remote)))
        return 0
    came = 0
    shown = sys.stderr.isatty()

    def progress(count: int) -> None:
        nonlocal came
        came += count
        if shown:
            print(f"\r{came / 1e6:.1f} MB", end="", file=sys.stderr, flush=True)

    def done(got: Got) -> None:
        if shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
        if got.error:
            print(f"objectfolder: {got.error}", file=sys.stderr)
        else:
            print(f"{got.path}  {got.path.stat().st_size / 1e6:.2f} MB, {got.outcome}")

    got = get(
        repository,
        options.ids,
        Path(options.output),
        revision=revision,
        stages=options.stage,
        remote=options.remote,
        jobs=options.jobs,
        done=done,
        progress=progress,
    )
    failed = sum(entry.error is not None for entry in got)
    if failed:
        print(f"{failed} of {len(got)} failed; the same command goes on where it was.", file=sys.stderr)
    return 1 if failed else 0
