"""Files whose removal costs time only: listed by kind with sizes, removed on request.

Nothing under ``data/`` or ``reports/``, nothing that git tracks and nothing that ``dvc.lock`` names is
ever touched, but for half-written files. DVC's own cache is left to ``dvc gc``.
"""

import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from objectfolder.atomic import PARTIAL
from objectfolder.errors import FormatError, InputError
from pipeline.cluster import performance_report
from pipeline.dataset.lock_file import LOCK, read_lock
from pipeline.dataset.products import ProductKind, read_fingerprint
from pipeline.dataset.stages import STAGES
from pipeline.dataset.state import PLAYERS, STATE
from pipeline.run import run_record
from pipeline.run.exclusive import exclusive, owner
from pipeline.sandbox import scratch
from pipeline.store import memo

LONGEST_LIST = 5  # paths of a kind that are named
DVC_HINT = (
    "DVC's cache is not touched. To drop versions that no commit needs: dvc gc --workspace --all-commits"
)


@dataclass(frozen=True)
class Removable:
    """A kind of file that may be removed, and the paths of that kind."""

    kind: str
    why: str
    paths: tuple[Path, ...]

    @property
    def size_bytes(self) -> int:
        """Bytes on disk of all of it."""
        return sum(map(_size, self.paths))


def clean_data_set(root: Path, *, remove: bool = False, with_memo: bool = False) -> None:
    """List what may be removed, and remove it where that is asked for.

    Parameters
    ----------
    root
        Root of the data set.
    remove
        Remove what is listed.
    with_memo
        Also products of other settings, which then are computed again.

    Raises
    ------
    InputError
        A run goes on here.
    """
    holder = owner(root)
    if holder is not None:
        raise InputError(str(root), f"in use by {holder}", "Wait until it has ended, or end it.")
    with exclusive(root, "clean"):
        found = [entry for entry in removable(root, with_memo) if entry.paths]
        for entry in found:
            print(f"{gigabytes(entry.size_bytes):>10}  {entry.kind}: {entry.why}")
            for path in entry.paths[:LONGEST_LIST]:
                print(f"{'':12}{_shown(path, root)}")
            if len(entry.paths) > LONGEST_LIST:
                print(f"{'':12}and {len(entry.paths) - LONGEST_LIST} more")
        total = gigabytes(sum(entry.size_bytes for entry in found))
        if remove:
            for entry in found:
                _remove(entry.paths)
            print(f"{total} removed" if found else "nothing to remove")
        else:
            print(f"{total} could be removed: run again with --yes" if found else "nothing to remove")
    print(DVC_HINT)


def removable(root: Path, with_memo: bool = False) -> list[Removable]:
    """Return what may be removed, by kind; a kind may have no paths."""
    protected = _protected(root)

    def entry(kind: str, why: str, paths: Iterable[Path]) -> Removable:
        return Removable(kind, why, tuple(path for path in sorted(paths) if not protected(path)))

    found = [
        entry("half-written files", "left by a process that was killed", _partial_files(root)),
        entry("scratch folders", "their owners are dead", scratch.abandoned()),
        entry("run records", "older than the last ones", run_record.excess(root)),
        entry("Dask's reports", "older than the last ones", performance_report.excess(root)),
        entry("marks of runs", "left by a driver that was killed", (root / STATE).glob("shared-*")),
        entry("players", "drawn anew from Object Files for the next report", (root / PLAYERS).glob("*")),
    ]
    if with_memo:
        found.append(entry("memo", "products of other settings", _unneeded_memos(root)))
    return found


def gigabytes(number: int) -> str:
    """Return bytes with a unit, for people."""
    for unit, size in (("GB", 1e9), ("MB", 1e6)):
        if number >= size:
            return f"{number / size:.1f} {unit}"
    return f"{number / 1e3:.1f} kB"


def _partial_files(root: Path) -> Iterator[Path]:
    for kind in _kinds():
        yield from (root / kind.folder).glob(f".*{PARTIAL}")
    for folder in (root / "runs", root / "reports", root / STATE):
        yield from folder.rglob(f".*{PARTIAL}")


def _unneeded_memos(root: Path) -> Iterator[Path]:
    """Yield the memos of products that are not in the data set now."""
    present = set()
    for kind in _kinds():
        for object_id in kind.object_ids(root):
            try:
                present.add(read_fingerprint(kind.path(root, object_id)))
            except FormatError:
                continue
    for folder in _memos(root):
        if folder.name not in present:
            yield folder


def _memos(root: Path) -> Iterator[Path]:
    yield from (path for path in memo.memo_base(root).glob("*/*") if path.is_dir())


def _kinds() -> list[ProductKind]:
    return [kind for stage in STAGES.values() for kind in stage.products]


def _protected(root: Path) -> Callable[[Path], bool]:
    """Return a function that says whether a path must stay, of whatever kind."""
    tracked = _tracked(root)
    kept = [root / "data", root / "reports", *_outputs(root)]

    def protected(path: Path) -> bool:
        if path in tracked or any(path in file.parents for file in tracked):
            return True
        half_written = path.name.startswith(".") and path.name.endswith(PARTIAL)
        return not half_written and any(path == folder or folder in path.parents for folder in kept)

    return protected


def _tracked(root: Path) -> set[Path]:
    """Return the files that git tracks; none where this is no repository or git is missing."""
    try:
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=root, capture_output=True, check=False)
    except FileNotFoundError:
        return set()
    return {root / name for name in listed.stdout.decode(errors="surrogateescape").split("\0") if name}


def _outputs(root: Path) -> list[Path]:
    """Return what ``dvc.lock`` names as read or made by a stage.

    Raises
    ------
    FormatError
        It is damaged: nothing is removed then.
    """
    path = root / LOCK
    return [root / name for name in read_lock(LOCK, path.read_bytes()).paths] if path.is_file() else []


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _size(path: Path) -> int:
    """Return the bytes on disk of a file, or of all in a folder; links are not followed."""
    try:
        if path.is_symlink() or not path.is_dir():
            return 512 * path.lstat().st_blocks
        return sum(_size(below) for below in path.iterdir())
    except OSError:  # removed meanwhile
        return 0


def _shown(path: Path, root: Path) -> str:
    return str(path.relative_to(root) if path.is_relative_to(root) else path)
