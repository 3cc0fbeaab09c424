"""The CPU seconds that a version took to make, where they were noted, and the bytes to fetch for it."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass

from rich.filesize import decimal

from objectfolder.errors import ObjectFolderError
from pipeline.audit.contents import Content, Contents
from pipeline.audit.versions import PER_OBJECT, Version
from pipeline.dataset.counts import counted
from pipeline.dataset.lock_file import is_folder
from pipeline.dataset.stages import STAGES
from pipeline.run.costs import number


def reported_costs(version: Version) -> dict[tuple[str | None, str], float | None]:
    """Return the CPU seconds by object and stage in a version's own report."""
    texts = [own.texts.get(PER_OBJECT, b"").decode(errors="replace") for own in version.data_sets]
    return {
        (row.get("id"), stage): number(row.get(f"cpu_seconds.{stage}"))
        for text in texts
        for row in csv.DictReader(io.StringIO(text))
        for stage in STAGES
    }


@dataclass(frozen=True)
class Fetch:
    """The files to fetch for one version where another is present.

    Parameters
    ----------
    bytes, files, unknown
        Bytes of all whose sizes are known, number of files, and of those with an unknown size.
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

    def __str__(self) -> str:
        text = f"{decimal(self.bytes)} in {counted(self.files, 'file')}"
        if self.unknown:
            text += f", and {counted(self.unknown, 'file')} of unknown size"
        if self.unlisted:
            text += f", and what {', '.join(self.unlisted)} has, of which the list is unknown"
        parts = ", ".join(f"{path} {decimal(count)}" for path, count in self.by_out.items() if count)
        return f"{text} ({parts})" if parts else text


def to_fetch(contents: Contents, old: Version, new: Version) -> Fetch:
    """Return the files to fetch for `new` where `old` is present."""
    unlisted: set[str] = set()
    old_hashes, new_hashes = _hashes(contents, old, new, unlisted), _hashes(contents, new, old, unlisted)
    present = set().union(*old_hashes.values())
    new_hashes = {path: hashes - present for path, hashes in new_hashes.items() if path not in unlisted}
    lying = {content.md5: content for folder in new.folders.values() for content in folder.products.values()}
    missing = set().union(*new_hashes.values())
    sizes = {md5: contents.size(lying.get(md5, Content(md5))) for md5 in missing}
    sizes |= contents.sizes_far(md5 for md5, size in sizes.items() if size is None)
    by_out = {path: sum(sizes[md5] or 0 for md5 in hashes) for path, hashes in new_hashes.items() if hashes}
    unknown = sum(size is None for size in sizes.values())
    in_all = sum(size or 0 for size in sizes.values())
    return Fetch(in_all, len(sizes), unknown, dict(sorted(by_out.items())), tuple(sorted(unlisted)))


def _hashes(contents: Contents, version: Version, other: Version, unlisted: set[str]) -> dict[str, set[str]]:
    """Return the hashes of a version's files by output, without outputs that the other version has unchanged.

    Outputs whose list of files cannot be read are added to `unlisted`; files that git has are left out.
    """
    hashes = dict(version.lying)
    same = set(other.lock.outs.values())
    for path, md5 in version.lock.outs.items():
        if path in hashes or path in version.texts or (md5 in same and path not in other.lying):
            continue
        hashes[path] = {md5}
        if is_folder(md5):
            try:
                hashes[path] = set(contents.folder(md5, path).values())
            except (ObjectFolderError, OSError):
                unlisted.add(path)
    return hashes
