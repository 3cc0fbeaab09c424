"""What a version took to make anew, as far as it was noted, and what there is to fetch of it."""

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import ObjectFolderError
from pipeline.audit.contents import Content, Contents
from pipeline.audit.versions import PER_OBJECT, Version
from pipeline.dataset.lock_file import DIRECTORY
from pipeline.run.costs import Costs, number

CPU_COLUMN = "cpu_seconds."


class KnownCosts:
    """CPU seconds of tasks: as measured here, else as the version's own report has them.

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
        """Return the CPU seconds of a product, None where nobody noted them."""
        known = self._measured.of(fingerprint)
        return known.cpu_s if known else self._reported.get((object_id, stage))


@dataclass(frozen=True)
class Fetch:
    """What there is to fetch to have one version when one has another.

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
    """Return what there is to fetch of `new` when one has `old`."""
    files: dict[str, set[str]] = {}  # by output: hashes
    unlisted: list[str] = []
    whole = {out.md5 for out in old.lock.outs.values()}
    in_git = {*old.texts, *new.texts}
    for path in {**new.lock.outs, **new.folders}:
        out = new.lock.outs.get(path)
        lying = new.folders.get(path)
        if lying is not None and lying.made and not lying.md5:
            files[path] = {one.md5 for one in lying.products.values()}
        elif out is not None and out.md5 not in whole and path not in in_git:
            files[path] = _hashes(contents, path, out.md5, unlisted)
    # Only what changed in a folder that both have is to be looked up in the old one.
    had: set[str] = set()
    for path in files:
        if path in old.lock.outs:
            had |= _hashes(contents, path, old.lock.outs[path].md5, unlisted)
        elif path in old.folders:
            had |= {one.md5 for one in old.folders[path].products.values()}
    wanted = {path: hashes - had for path, hashes in files.items() if path not in unlisted}
    sizes = _sizes(contents, wanted, new)
    by_out = {path: sum(size or 0 for size in found.values()) for path, found in sizes.items() if found}
    every = {md5: size for found in sizes.values() for md5, size in found.items()}
    return Fetch(
        sum(size or 0 for size in every.values()),
        len(every),
        sum(size is None for size in every.values()),
        dict(sorted(by_out.items())),
        tuple(dict.fromkeys(unlisted)),
    )


def _hashes(contents: Contents, path: str, md5: str, unlisted: list[str]) -> set[str]:
    """Return the hashes of an output's files; one whose list cannot be read is put to the unlisted."""
    if not md5.endswith(DIRECTORY):
        return {md5}
    try:
        return set(contents.folder(md5, path).values())
    except (ObjectFolderError, OSError):
        unlisted.append(path)
        return set()


def _sizes(
    contents: Contents, wanted: Mapping[str, Iterable[str]], new: Version
) -> dict[str, dict[str, int | None]]:
    lying = {one.md5: one for folder in new.folders.values() for one in folder.products.values() if one.path}
    found: dict[str, dict[str, int | None]] = {
        path: {md5: contents.size(lying.get(md5, Content(md5))) for md5 in hashes}
        for path, hashes in wanted.items()
    }
    far = {md5 for sizes in found.values() for md5, size in sizes.items() if size is None}
    known = contents.sizes_far(far)
    return {path: {md5: known.get(md5, size) for md5, size in sizes.items()} for path, sizes in found.items()}
