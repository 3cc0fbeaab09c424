"""The command `check`: a table of objects, before anything is made of it."""

import argparse
import shutil
import sys
from pathlib import Path
from typing import Any

from objectfolder.errors import ObjectFolderError

REPOSITORY = Path(__file__).parents[2]

FINE, FOUND, ERROR = 0, 1, 2
STATUS = """exit status:
  0  no errors (with --strict: no warnings either)
  1  some were found
  2  the table cannot be read

A doubt that was looked at and stays is listed in the column `accepted`, by the name of its rule
(length, mass, walls, surface, material, licence, provenance, duplicate); the notes say why.
"""


def add_commands(commands: Any) -> None:
    """Add the commands of this module to a parser's sub-commands."""
    text = "find what is wrong or doubtful in a table of objects: units, masses, materials, licences, walls"
    command = commands.add_parser(
        "check",
        help=text,
        description=f"{text.capitalize()}. Nothing is changed; what is not fetched yet is said.",
        epilog=STATUS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument("table", metavar="CATALOGUE", help="a table of objects (CSV)")
    command.add_argument("--json", action="store_true", help="print all that was found as JSON")
    command.add_argument("--strict", action="store_true", help="warnings count as errors")
    command.add_argument(
        "--no-meshes", action="store_true", help="look at the table alone, at once (a mesh takes a second)"
    )
    command.add_argument(
        "--materials", default=str(REPOSITORY / "data" / "materials.csv"), help="materials table (CSV)"
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check a table; return the exit status."""
    from pipeline.intake.check import finding
    from pipeline.intake.check.listing import as_json, text
    from pipeline.intake.check.table_check import check_table

    table = Path(options.table)
    try:
        check = check_table(
            table, Path(options.materials), with_meshes=not options.no_meshes, progress=_progress
        )
    except ObjectFolderError as error:
        print(f"objectfolder: {error}", file=sys.stderr)
        return ERROR
    if options.json:
        print(as_json(check, table))
    else:
        print(text(check, table, shutil.get_terminal_size((120, 24)).columns))
    failing = check.count(finding.ERROR) + (check.count(finding.WARNING) if options.strict else 0)
    return FOUND if failing else FINE


def _progress(done: int, rows: int, object_id: str) -> None:
    """Say on a terminal which object is measured, on a line that is written over."""
    if sys.stderr.isatty():
        line = f"{done} of {rows}  {object_id}"[:100] if object_id else ""
        sys.stderr.write(f"\r\x1b[K{line}")
        sys.stderr.flush()
