"""The CPU seconds that a version took to make, where they were noted, and the bytes to fetch for it."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import ObjectFolderError
from pipeline.audit.contents import Content, Contents
from pipeline.audit.versions import PER_OBJECT, Version
from pipeline.run.costs import Costs, number

CPU_COLUMN = "cpu_seconds."


class KnownCosts:
    """CPU seconds of tasks: measured here, else read from the version's own report.

    Parameters
    ----------
    root
        Root of the data set.
    version
        Whose report.
    """

    def __init__(self, root: Path, version: Version) -> None:
        self._measured = Costs(root)
        self._reported: dict[tuple[str, str], float] = {}
        text = version.texts.get(PER_OBJECT, b"").decode(errors="replace")
        for row in csv.DictReader(io.StringIO(text)):
            for column, value in row.items():
                seconds = number(value)
                if isinstance(column, str) and column.startswith(CPU_COLUMN) and seconds is not None:
                    self._reported[row.get("id") or "", column.removeprefix(CPU_COLUMN)] = seconds

    def of(self, object_id: str, stage: str, fingerprint: str) -> float | None:
        """Return the CPU seconds of a product; None where no file has them."""
        known = self._measured.of(fingerprint)
        return known.cpu_s if known else self._reported.get((object_id, stage))


@dataclass(frozen=True)
class Fetch:
    """The files to fetch for one version where another is present.

    Parameters
    ----------
    bytes
        In all, as far as sizes are known.
    files
        How many.
    unknown
        How many of them are of unknown size.
    by_out
        Bytes by output of the data set.
    unlisted
        Outputs whose list of files cannot be read in one of the versions; nothing of them is counted.
    """

    bytes: int
    files: int
    unknown: int
    by_out: Mapping[str, int]
    unlisted: tuple[str, ...] = ()


def to_fetch(contents: Contents, old: Version, new: Version) -> Fetch:
    """Return the files to fetch for `new` where `old` is present."""
    unlisted: list[str] = []
    had, wanted = _hashes(contents, old, new, unlisted), _hashes(contents, new, old, unlisted)
    every = set().union(*had.values())
    wanted = {path: hashes - every for path, hashes in wanted.items() if path not in unlisted}
    lying = {one.md5: one for folder in new.folders.values() for one in folder.products.values()}
    missing = set().union(*wanted.values())
    sizes = {md5: contents.size(lying.get(md5, Content(md5))) for md5 in missing}
    sizes |= contents.sizes_far(md5 for md5, size in sizes.items() if size is None)
    by_out = {path: sum(sizes[md5] or 0 for md5 in hashes) for path, hashes in wanted.items() if hashes}
    return Fetch(
        sum(size or 0 for size in sizes.values()),
        len(sizes),
        sum(size is None for size in sizes.values()),
        dict(sorted(by_out.items())),
        tuple(unlisted),
    )


def _hashes(contents: Contents, version: Version, other: Version, unlisted: list[str]) -> dict[str, set[str]]:
    """Return the hashes of a version's files by output, without the outputs that are equal in the other.

    Outputs whose list of files cannot be read are put to the unlisted. What git has is not fetched by DVC.
    """
    found = {path: version.lying(path) for path in version.folders if version.lying(path)}
    same = {out.md5 for out in version.lock.outs.values()} & {out.md5 for out in other.lock.outs.values()}
    for path, out in version.lock.outs.items():
        if path in found or path in version.texts or (out.md5 in same and not other.lying(path)):
            continue
        found[path] = {out.md5}
        if out.is_folder:
            try:
                found[path] = set(contents.folder(out.md5, path).values())
            except (ObjectFolderError, OSError):
                unlisted += [path] if path not in unlisted else []
    return found
