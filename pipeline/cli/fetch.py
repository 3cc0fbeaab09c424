"""The command `fetch`: objects of published collections, checked, where tables of objects expect them."""

import argparse
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from objectfolder.errors import InputError, ObjectFolderError

if TYPE_CHECKING:
    from pipeline.intake.sources.fetching import Fetched, Fetcher
    from pipeline.intake.sources.registry import Resolutions
    from pipeline.intake.sources.source_table import SourceRow

MIRRORS = "OBJECTFOLDER_MIRRORS"
EPILOG = """examples:
  objectfolder fetch ycb:025_mug gso:ACE_Coffee_Mug_Kristen_16_oz_cup polyhaven:Television_01
  objectfolder fetch --table data/objects.csv
  objectfolder fetch --table data/objects.csv --only 025_mug 024_bowl --dry-run
  objectfolder fetch --list gso

What is there and whole is not fetched again; what was interrupted goes on where it was. Without --table
everything lies as for data/objects.csv.
"""


def add_commands(commands: Any) -> None:
    """Add the commands of this module to a parser's sub-commands."""
    text = "fetch objects of published collections (YCB, Google Scanned Objects, Poly Haven), checked"
    command = commands.add_parser(
        "fetch",
        help=text,
        description=text,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument("ids", nargs="*", metavar="SOURCE:NAME", help="objects, as ycb:025_mug")
    command.add_argument("--table", metavar="TABLE", help="the objects of a table that have a source_id")
    command.add_argument("--only", nargs="+", default=[], metavar="ID", help="of the table, these ids alone")
    command.add_argument("--list", metavar="SOURCE", help="print the ids of all that a source has")
    command.add_argument("--dry-run", action="store_true", help="print what would be fetched")
    command.add_argument(
        "--folder", help="where objects come: FOLDER/SOURCE/NAME (default: fetched beside TABLE)"
    )
    command.add_argument("--cache", help="where downloads are kept (default: .downloads in the folder)")
    command.add_argument(
        "--hashes",
        metavar="TABLE",
        help="what is known of files, and is added to (default: source_hashes.csv beside TABLE)",
    )
    command.add_argument(
        "--resolution",
        action="append",
        default=[],
        metavar="[SOURCE=]NAME",
        help="as polyhaven=2k or google_64k (default: 1k, google_16k); may be given again",
    )
    command.add_argument(
        "--mirror",
        action="append",
        default=[],
        metavar="SOURCE=URL",
        help=f"ask URL in place of a source; may be given again, or in {MIRRORS}, separated by spaces",
    )
    command.add_argument("--proxy", metavar="URL", help="ask through it (default: HTTPS_PROXY and the like)")
    command.add_argument(
        "--retries",
        type=int,
        default=6,
        metavar="N",
        help="how often to ask a source again that sends nothing new (default 6)",
    )
    command.add_argument("--refresh", action="store_true", help="ask anew for what is there")
    command.add_argument(
        "--accept-changed", action="store_true", help="take and record content that is not what was known"
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Fetch, one object after another; 1 if any failed."""
    from pipeline.intake.sources.download import Downloader
    from pipeline.intake.sources.fetching import Fetcher
    from pipeline.intake.sources.registry import Resolutions, mirrored_addresses, source_named
    from pipeline.intake.sources.source_table import chosen_rows, read_source_rows

    if sum(map(bool, (options.ids, options.table, options.list))) != 1:
        raise InputError("fetch", "names no objects, or in several ways", "Give ids, or --table, or --list.")
    if options.only and not options.table:
        raise InputError("--only", "chooses from a table", "Give --table too.")
    if options.retries < 0:
        raise InputError("--retries", str(options.retries), "Give a number from 0 on.")
    table = Path(options.table or "data/objects.csv")
    folder = Path(options.folder) if options.folder else table.parent / "fetched"
    resolutions = Resolutions(options.resolution)
    shown = Progress()
    fetcher = Fetcher(
        folder,
        Downloader(
            Path(options.cache) if options.cache else folder / ".downloads",
            proxies={"http": options.proxy, "https": options.proxy} if options.proxy else None,
            mirrors=mirrored_addresses([*os.environ.get(MIRRORS, "").split(), *options.mirror]),
            retries=options.retries,
            progress=shown.came,
        ),
        Path(options.hashes) if options.hashes else table.parent / "source_hashes.csv",
        refresh=options.refresh,
        accept_changed=options.accept_changed,
    )
    if options.list:
        source = source_named(options.list)
        print("\n".join(source.source_id(name) for name in fetcher.names(source)))
        return 0
    known = read_source_rows(table) if options.table else _rows_of(table)
    rows = chosen_rows(table, known, options.only) if options.table else []
    ids = list(dict.fromkeys(options.ids or [row.source_id for row in rows]))
    if options.dry_run:
        return _dry_run(fetcher, ids, resolutions)
    return _fetch(fetcher, ids, resolutions, shown, table, known)


def _rows_of(table: Path) -> "list[SourceRow]":
    """Return the rows of a table that was not asked for, to compare with; none where there is none."""
    from pipeline.intake.sources.source_table import read_source_rows

    try:
        return read_source_rows(table)
    except InputError:
        return []


def _fetch(
    fetcher: "Fetcher",
    ids: list[str],
    resolutions: "Resolutions",
    shown: "Progress",
    table: Path,
    known: "list[SourceRow]",
) -> int:
    """Fetch all; say of each what it is, and at the end what failed."""
    from pipeline.intake.sources.fetching_all import Failed, fetch_all

    fetched: list[Fetched] = []
    failed: list[Failed] = []
    for number, outcome in enumerate(fetch_all(fetcher, ids, resolutions, shown.begin), start=1):
        shown.clear()
        count = f"{number}/{len(ids)} " if len(ids) > 1 else ""
        if isinstance(outcome, Failed):
            failed.append(outcome)
            print(f"objectfolder: {count}{outcome.error}", file=sys.stderr)
        else:
            fetched.append(outcome)
            print(f"{count}{_told(outcome)}", flush=True)
            _print_differences(outcome, table, known)
    in_table = {row.source_id for row in known}
    new = [outcome for outcome in fetched if outcome.asked.id not in in_table]
    if new:
        _print_rows(new, table)
    if len(ids) > 1:
        size = sum(outcome.bytes for outcome in fetched)
        print(f"{len(fetched)} of {len(ids)} are there, {size / 1e6:.1f} MB")
    if failed and len(ids) > 1:
        print(f"{len(failed)} of {len(ids)} failed; the same command goes on where it was:", file=sys.stderr)
        for failure in failed:
            print(f"  {failure.source_id}: {failure.error.finding}", file=sys.stderr)
    return 1 if failed else 0


def _told(fetched: "Fetched") -> str:
    source = fetched.asked.source
    size = f"{len(fetched.form.files)} files, {fetched.bytes / 1e6:.2f} MB"
    new = f", hashes recorded: {fetched.recorded}" if fetched.recorded else ""
    return (
        f"{fetched.asked.id}  {fetched.outcome}, {size}{new}\n"
        f"  mesh     {fetched.mesh}\n"
        f"  texture  {fetched.texture or 'named by the mesh'}\n"
        f"  licence  {source.licence}; {source.attribution}"
    )


def _print_differences(fetched: "Fetched", table: Path, known: "list[SourceRow]") -> None:
    """Say which rows name other files than those that came."""
    for row in known:
        if row.source_id != fetched.asked.id:
            continue
        for what, cell, path in (("mesh", row.mesh, fetched.mesh), ("texture", row.texture, fetched.texture)):
            if cell and (path is None or not _same(table.parent / cell, path)):
                print(
                    f"objectfolder: {table}, {row.id}: its {what} is {cell}, what came is {path}",
                    file=sys.stderr,
                )


def _same(one: Path, other: Path) -> bool:
    return one.resolve() == other.resolve()


def _print_rows(new: "list[Fetched]", table: Path) -> None:
    from pipeline.intake.sources.proposed_row import proposed_rows

    print(f"\nRows for {table}, each to be given its material:")
    print(proposed_rows(new, table.parent), end="")


def _dry_run(fetcher: "Fetcher", ids: list[str], resolutions: "Resolutions") -> int:
    """Print addresses and sizes; documents are asked for, files are not."""
    failed = total = unknown = 0
    for source_id in ids:
        try:
            missing = fetcher.missing(resolutions.asked(source_id))
        except ObjectFolderError as error:
            failed += 1
            print(f"objectfolder: {error}", file=sys.stderr)
            continue
        print(f"{source_id}  {f'{len(missing)} to fetch' if missing else 'already there'}")
        for entry in missing:
            total += entry.size or 0
            unknown += entry.size is None
            size = "size not told" if entry.size is None else f"{entry.size / 1e6:.2f} MB"
            print(f"  {entry.url}  {size}")
    print(f"{total / 1e6:.1f} MB{f' and {unknown} files of unknown size' if unknown else ''}")
    return 1 if failed else 0


class Progress:
    """A line on the terminal that is written over, and nothing where there is no terminal."""

    def __init__(self) -> None:
        self._shown = sys.stderr.isatty()
        self._source_id = ""
        self._next = 0.0

    def begin(self, source_id: str) -> None:
        """Say which object is next."""
        self._source_id = source_id
        if self._shown:
            self._write(source_id)

    def came(self, url: str, count: int, total: int | None) -> None:
        """Say how much of a file there is."""
        now = time.monotonic()
        if self._shown and (now >= self._next or count == total):
            self._next = now + 0.2
            size = f" of {total / 1e6:.1f}" if total is not None else ""
            self._write(f"{self._source_id}  {count / 1e6:.1f}{size} MB  {url.rpartition('/')[2]}")

    def clear(self) -> None:
        """Leave the line to others."""
        if self._shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()

    def _write(self, text: str) -> None:
        sys.stderr.write(f"\r\x1b[K{text[:120]}")
        sys.stderr.flush()
