"""The commands `audit`, `verify` and `history`, for the data set in the current folder."""

import argparse
import gc
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from objectfolder.errors import ObjectFolderError

# What a run of these commands says by its exit status.
FINE, EXCEEDED, ERROR = 0, 1, 2
STATUS = """exit status:
  0  fine
  1  {one}
  2  an error: nothing, or not all, could be looked at
"""


def add_commands(commands: Any) -> None:
    """Add the commands of this module to a parser's sub-commands."""
    _add_audit(commands)
    _add_verify(commands)
    _add_history(commands)


def _add_audit(commands: Any) -> None:
    text = "say what changed between two versions of the data set, why, and what it did to fidelity"
    command = commands.add_parser(
        "audit",
        help=text,
        description=f"{text.capitalize()}. Nothing is checked out; of products only attributes are read.",
        epilog=STATUS.format(one="a threshold of --max-loss is exceeded"),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument("old", nargs="?", default="HEAD", metavar="A", help="a git revision (HEAD)")
    command.add_argument("new", nargs="?", metavar="B", help="a git revision (default: the work tree)")
    command.add_argument("--arrays", action="store_true", help="read the arrays of what changed")
    command.add_argument(
        "--max-loss",
        action="append",
        default=[],
        metavar="MEASURE=LOSS",
        help="largest loss of an object that is allowed, as vision.psnr_db=0.5; may be given several times",
    )
    command.add_argument("--json", action="store_true", help="print all that was found as JSON")
    command.add_argument("--html", metavar="FILE", help="write a page that needs no network")
    command.add_argument(
        "--remote", default="", help="where to read what is not in the cache (DVC's default)"
    )
    command.set_defaults(run=run_audit)


def _add_verify(commands: Any) -> None:
    text = "read every file of a version and say which is damaged, and what to do"
    command = commands.add_parser(
        "verify",
        help=text,
        description=f"{text.capitalize()}: hashes against dvc.lock, checksums, fingerprints, lineage.",
        epilog=STATUS.format(one="something is wrong with a file, or a product made again is different"),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument("revision", nargs="?", metavar="REV", help="a git revision (default: the work tree)")
    command.add_argument(
        "--recompute", type=int, default=0, metavar="N", help="make N products drawn at random again, compare"
    )
    command.add_argument("--seed", type=int, default=0, help="of the draw (0)")
    command.add_argument("--json", action="store_true", help="print all that was found as JSON")
    command.set_defaults(run=run_verify)


def _add_history(commands: Any) -> None:
    text = "list the versions of one object: commits, why it changed, fidelity"
    command = commands.add_parser("history", help=text, description=text.capitalize() + ".")
    command.add_argument("object", metavar="OBJECT", help="an id")
    command.add_argument("--rev", default="HEAD", metavar="REV", help="the last version (HEAD)")
    command.add_argument("--json", action="store_true", help="print all that was found as JSON")
    command.add_argument("--remote", default="", help="of DVC, for what is not in the cache (its default)")
    command.set_defaults(run=run_history)


def run_audit(options: argparse.Namespace) -> int:
    """Compare two versions; return the exit status."""
    from pipeline.audit.as_json import audit_json
    from pipeline.audit.comparison import Comparison
    from pipeline.audit.contents import Contents
    from pipeline.audit.fidelity import exceeded, thresholds
    from pipeline.audit.git import GitRepository
    from pipeline.audit.table import change, table
    from pipeline.audit.versions import commit_version, data_set_root, work_tree_version
    from pipeline.dataset.stages import STAGES

    stages = tuple(STAGES.values())
    # What is kept has no cycles, and looking for some among a million dictionaries takes seconds.
    collecting = gc.isenabled()
    gc.disable()
    try:
        allowed = thresholds(options.max_loss)
        root = data_set_root(Path.cwd())
        git = GitRepository(root)
        with Contents(root, options.remote) as contents:
            old = commit_version(git, contents, options.old, stages)
            new = (
                commit_version(git, contents, options.new, stages)
                if options.new is not None
                else work_tree_version(contents, stages)
            )
            audit = Comparison(contents, old, new, stages, options.arrays).audit()
        too_much = exceeded(audit.fidelity, allowed)
        if options.html:
            from pipeline.publish.report.audit_page import write_page

            write_page(audit, Path(options.html), too_much, allowed)
    except (ObjectFolderError, OSError) as error:
        return failed(error)
    finally:
        if collecting:
            gc.enable()
    if options.json:
        print(audit_json(audit, too_much, allowed))
    else:
        print(table(audit, shutil.get_terminal_size((100, 24)).columns))
        for one in too_much:
            limit = f"more than the {allowed[one.measure]:g} allowed"
            print(f"too much: {one.object_id}: {one.measure} {change(one)}, {limit}")
    if allowed and audit.problems:
        print("objectfolder: what could not be read was not judged.", file=sys.stderr)
        return ERROR
    return EXCEEDED if too_much else FINE


def run_verify(options: argparse.Namespace) -> int:
    """Read every file of a version; return the exit status."""
    from pipeline.audit.as_json import verified_json
    from pipeline.audit.contents import Contents
    from pipeline.audit.git import GitRepository
    from pipeline.audit.listings import remade_text, verified_text
    from pipeline.audit.recomputation import FAILED, recompute
    from pipeline.audit.reproducibility import DIFFERENT
    from pipeline.audit.verification import verify
    from pipeline.audit.versions import commit_version, data_set_root, work_tree_version
    from pipeline.dataset.stages import STAGES

    stages = tuple(STAGES.values())
    width = shutil.get_terminal_size((100, 24)).columns
    try:
        root = data_set_root(Path.cwd())
        with Contents(root) as contents, ProgressLine() as line:
            if options.revision is None:
                version = work_tree_version(contents, stages)
            else:
                version = commit_version(GitRepository(root), contents, options.revision, stages)
            found = verify(contents, version, stages, line.files)
            remade = []
            if options.recompute > 0:
                remade = recompute(
                    contents, version, stages, options.recompute, options.seed, started=line.task
                )
    except (ObjectFolderError, OSError) as error:
        return failed(error)
    if options.json:
        print(verified_json(found, remade))
    else:
        print(verified_text(found, version.label, width))
        if remade:
            print(remade_text(remade, width))
    wrong = found.findings or any(one.verdict in (DIFFERENT, FAILED) for one in remade)
    return EXCEEDED if wrong else FINE


def run_history(options: argparse.Namespace) -> int:
    """List the versions of an object; return the exit status."""
    from pipeline.audit.as_json import history_json
    from pipeline.audit.contents import Contents
    from pipeline.audit.git import GitRepository
    from pipeline.audit.history import history
    from pipeline.audit.listings import history_text
    from pipeline.audit.versions import data_set_root
    from pipeline.dataset.stages import STAGES

    try:
        root = data_set_root(Path.cwd())
        git = GitRepository(root)
        with Contents(root, options.remote) as contents:
            found, unreadable = history(git, contents, options.object, tuple(STAGES.values()), options.rev)
    except (ObjectFolderError, OSError) as error:
        return failed(error)
    if options.json:
        print(history_json(options.object, found, unreadable))
    else:
        print(history_text(options.object, found, unreadable, shutil.get_terminal_size((100, 24)).columns))
    return FINE


class ProgressLine:
    """A line on the terminal that is written over, and nothing where there is no terminal."""

    def __init__(self) -> None:
        self._shown = sys.stderr.isatty()
        self._next = 0.0

    def __enter__(self) -> "ProgressLine":
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            sys.stderr.write("\r\x1b[K")

    def files(self, done: int, count: int, read: int) -> None:
        """Say how many files are done."""
        now = time.monotonic()
        if self._shown and (now >= self._next or done == count):
            self._next = now + 0.2
            self._write(f"{done} of {count} files, {read / 1e9:.2f} GB")

    def task(self, stage: str, object_id: str) -> None:
        """Say what is made again."""
        if self._shown:
            self._write(f"making {stage} {object_id} again")

    def _write(self, text: str) -> None:
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()


def failed(error: Exception) -> int:
    """Print an error; return the exit status."""
    print(f"objectfolder: {error}", file=sys.stderr)
    return ERROR
