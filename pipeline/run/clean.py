"""Files whose removal costs time only: listed by kind with sizes, removed on request.

Nothing under ``data/`` or ``reports/``, nothing that git tracks and nothing that ``dvc.lock`` names is
ever touched, but for half-written files. DVC's own cache is left to ``dvc gc``.
"""

import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.filesize import decimal

from objectfolder.errors import InputError
from objectfolder.products.atomic import PARTIAL
from pipeline.dataset.git_index import tracked_files
from pipeline.dataset.lock_file import LOCK, read_lock
from pipeline.dataset.products import PLAYERS, STATE
from pipeline.dataset.stages import STAGES
from pipeline.run import run_record
from pipeline.run.damage import SET_ASIDE
from pipeline.run.exclusive import exclusive, owner
from pipeline.sandbox import scratch

LONGEST_LIST = 5  # paths of a kind that are named
DVC_HINT = (
    "DVC's cache is not touched. To drop versions that no commit needs: dvc gc --workspace --all-commits"
)


@dataclass(frozen=True, kw_only=True)
class FilesOfKind:
    """A kind of file that may be removed: its size on disk and its paths, from the root on where below it."""

    kind: str
    why: str
    bytes: int
    paths: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class CleanSummary:
    """What may be removed, its size on disk, and whether it was removed; ``str`` words it in lines."""

    kinds: tuple[FilesOfKind, ...]
    bytes: int
    removed: bool

    def __str__(self) -> str:
        lines = []
        for entry in self.kinds:
            lines.append(f"{decimal(entry.bytes):>10}  {entry.kind}: {entry.why}")
            lines += [f"{'':12}{path}" for path in entry.paths[:LONGEST_LIST]]
            if len(entry.paths) > LONGEST_LIST:
                lines.append(f"{'':12}and {len(entry.paths) - LONGEST_LIST} more")
        if not self.kinds:
            lines.append("nothing to remove")
        elif self.removed:
            lines.append(f"{decimal(self.bytes)} removed")
        else:
            lines.append(f"{decimal(self.bytes)} could be removed: run again with --yes")
        return "\n".join([*lines, DVC_HINT])


def clean_data_set(root: Path, *, remove: bool = False) -> CleanSummary:
    """Find what may be removed; `remove` it if asked to.

    Raises
    ------
    InputError
        A run goes on here, or git's index cannot be read.
    """
    holder = owner(root)
    if holder is not None:
        raise InputError(str(root), f"in use by {holder}", "Wait until it has ended, or end it.")
    with exclusive(root, "clean"):
        kinds = tuple(entry for entry in removable(root) if entry.paths)
        for path in (root / path for entry in kinds for path in entry.paths if remove):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
    return CleanSummary(
        kinds=kinds, bytes=sum(entry.bytes for entry in kinds), removed=remove and bool(kinds)
    )


def removable(root: Path) -> list[FilesOfKind]:
    """Return what may be removed, by kind; a kind may have no paths."""
    is_protected = _protected(root)

    def entry(kind: str, why: str, paths: Iterable[Path]) -> FilesOfKind:
        free = [path for path in sorted(paths) if not is_protected(path)]
        names = (str(path.relative_to(root) if path.is_relative_to(root) else path) for path in free)
        return FilesOfKind(kind=kind, why=why, bytes=sum(map(_size, free)), paths=tuple(names))

    return [
        entry("half-written files", "left by a process that was killed", _partial_files(root)),
        entry("scratch folders", "their owners are dead", scratch.abandoned()),
        entry("keys of batch jobs", "their drivers are dead", scratch.abandoned(root / scratch.KEYS)),
        entry("run records", "older than the last ones", run_record.excess(root)),
        entry("damaged products", "set aside and made again", (root / SET_ASIDE).glob("*/*")),
        entry("marks of runs", "left by a driver that was killed", (root / STATE).glob("shared-*")),
        entry("copies of products", "kept by earlier versions", (root / STATE).glob("memo")),
        entry("files of pages", "left by a report that was killed", (root / STATE / "pages").glob("*")),
        entry("players", "drawn anew from Object Files for the next report", (root / PLAYERS).glob("*")),
    ]


def _partial_files(root: Path) -> Iterator[Path]:
    for kind in (kind for stage in STAGES.values() for kind in stage.products):
        yield from (root / kind.folder).glob(f".*{PARTIAL}")
    for folder in (root / "runs", root / "reports", root / STATE):
        yield from folder.rglob(f".*{PARTIAL}")


def _protected(root: Path) -> Callable[[Path], bool]:
    """Return a function that says whether a path must stay, of whatever kind.

    Raises
    ------
    FormatError
        ``dvc.lock``, which names what stages read and make, is damaged: nothing is removed then.
    """
    files = tracked_files(root)
    lock = root / LOCK
    outputs = read_lock(LOCK, lock.read_bytes()).paths if lock.is_file() else ()
    roots = {root / name for name in ("data", "reports", *outputs)}

    def protected(path: Path) -> bool:
        if path in files or any(path in file.parents for file in files):
            return True
        half_written = path.name.startswith(".") and path.name.endswith(PARTIAL)
        return not half_written and not roots.isdisjoint((path, *path.parents))

    return protected


def _size(path: Path) -> int:
    """Return the bytes on disk of a file, or of all in a folder; links are not followed."""
    try:
        below = path.iterdir() if path.is_dir() and not path.is_symlink() else ()
        return 512 * path.lstat().st_blocks + sum(map(_size, below))
    except OSError:  # removed meanwhile
        return 0
