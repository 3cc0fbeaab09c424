"""Every file of a version read whole: hash, own checksums, fingerprint, and what it was made from."""

import hashlib
import operator
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, ObjectFolderError
from objectfolder.object_file.container import FORMAT
from objectfolder.object_file.object_file import ObjectFile
from pipeline.audit.contents import Contents
from pipeline.audit.descriptions import Description
from pipeline.audit.reasons import is_labelled_truly
from pipeline.audit.versions import Version
from pipeline.dataset import products
from pipeline.dataset.lock_file import LOCK, is_folder
from pipeline.dataset.partition_folders import inside
from pipeline.dataset.products import TENSORS, ProductKind, md5_of
from pipeline.dataset.stage import Stage

AT_ONCE = 4  # files read at the same time: disks and hashes, not processors, are what is waited for
DAMAGED, OTHER, MISSING, UNLISTED, MISLABELLED, MADE_FROM_ANOTHER = (
    "damaged", "other content", "missing", "not listed", "mislabelled", "made from another",
)  # fmt: skip
REMAKE = "Delete it, then run `dvc repro`."
Progress = Callable[[int, int, int], None]


@dataclass(frozen=True)
class Finding:
    """A fault of a file: its path in the version, one of the words above, what is wrong, and what to do."""

    where: str
    kind: str
    finding: str
    remedy: str


@dataclass(frozen=True)
class Verified:
    """Number of files and bytes that were read, and faults; none where all is as it should be."""

    files: int
    bytes: int
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class _Item:
    where: str
    md5: str  # that it should have; empty for a file that no list names
    path: Path | None
    kind: ProductKind | None = None
    object_id: str = ""
    text: bytes | None = None  # for what git holds

    def finding(self, kind: str, text: str, remedy: str) -> Finding:
        return Finding(self.where, kind, text, remedy)


def verify(
    contents: Contents, version: Version, stages: Sequence[Stage], progress: Progress = lambda *_: None
) -> Verified:
    """Read every file of a version and check all that can be checked.

    Parameters
    ----------
    contents
        Where files lie.
    version
        The work tree, whose files are compared with its ``dvc.lock``, or a commit, whose files are those of
        the cache.
    stages
        All stages.
    progress
        Called with files done, files in all and bytes done.
    """
    items, findings = _items(contents, version, stages)
    if version.damage is not None:
        findings.append(Finding(LOCK, DAMAGED, version.damage.finding, version.damage.remedy))
    descriptions: dict[tuple[str, str], Description] = {}
    file_count = byte_count = 0
    with ThreadPoolExecutor(AT_ONCE) as pool, tempfile.TemporaryDirectory(prefix="objectfolder-") as scratch:
        checks = pool.map(lambda item: _check(item, contents, version, Path(scratch)), items)
        for item, (size, item_findings, description) in zip(items, checks, strict=True):
            file_count, byte_count = file_count + 1, byte_count + size
            findings += item_findings
            if description is not None and item.kind is not None:
                descriptions[item.kind.name, item.object_id] = description
            progress(file_count, len(items), byte_count)
    findings += _lineage(stages, descriptions)
    return Verified(
        file_count, byte_count, tuple(sorted(findings, key=lambda finding: (finding.where, finding.kind)))
    )


def _items(
    contents: Contents, version: Version, stages: Sequence[Stage]
) -> tuple[list[_Item], list[Finding]]:
    kinds = {kind.folder: kind for stage in stages for kind in stage.products}
    items: list[_Item] = []
    findings: list[Finding] = []
    lying = version.commit is None
    for path, listed_md5 in sorted(version.lock.outs.items()):
        place = contents.root / path if lying else contents.path(listed_md5)
        if not is_folder(listed_md5):
            # What DVC does not cache is in git.
            items.append(_Item(path, listed_md5, place, text=None if lying else version.texts.get(path)))
            continue
        listing = contents.path(listed_md5)
        if listing is not None:
            items.append(_Item(f"{path} (its list of files in the cache)", listed_md5[:32], listing))
        try:
            files = contents.folder(listed_md5, path)
        except ObjectFolderError as error:
            findings.append(Finding(path, MISSING, error.finding, error.remedy))
            continue
        if lying and not (contents.root / path).is_dir():
            finding = f"none of its {len(files)} files exists"
            findings.append(Finding(path, MISSING, finding, f"`dvc pull {path}`, or `dvc checkout {path}`."))
            continue
        kind = kinds.get(inside(path))
        for name, md5 in sorted(files.items()):
            place = contents.root / path / name if lying else contents.path(md5)
            object_id = name.removesuffix(kind.suffix) if kind is not None else ""
            items.append(_Item(f"{path}/{name}", md5, place, kind, object_id))
    places = {item.where for item in items}
    for folder, kind in kinds.items():
        for object_id, content in version.folders[folder].products.items():
            if content.path is not None and content.where not in places:
                items.append(_Item(content.where, "", content.path, kind, object_id))
    return items, findings


def _check(
    item: _Item, contents: Contents, version: Version, scratch: Path
) -> tuple[int, list[Finding], Description | None]:
    """Return bytes read, the findings, and the description of the product."""
    try:
        size, digest = _hashed(item)
    except FileNotFoundError:
        return 0, [item.finding(MISSING, "there is no such file", _restore(item, contents))], None
    except OSError as error:
        text = f"cannot be read ({error.strerror})"
        return 0, [item.finding(DAMAGED, text, "Check the disk and the permissions of the file.")], None
    findings = []
    if item.md5 and digest != item.md5:
        text = f"its MD5 is {digest}, the version lists {item.md5}"
        findings = [item.finding(OTHER, text, _restore(item, contents))]
    elif not item.md5 and version.damage is None:
        remedy = "Run `dvc repro`, or `dvc commit` if the file belongs to the data set."
        findings = [item.finding(UNLISTED, "intact, but not listed in dvc.lock", remedy)]
    if item.kind is None or item.path is None:
        return size, findings, None
    try:
        description = _opened(item.path, item.kind, item.md5 or item.object_id, scratch)
    except (ObjectFolderError, OSError) as error:
        text = error.finding if isinstance(error, ObjectFolderError) else str(error)
        # One finding a file: that it is not what the list says follows from its damage.
        return size, [item.finding(DAMAGED, text, _restore(item, contents))], None
    if not is_labelled_truly(description):
        text = "its fingerprint is not that of the parts it names"
        findings.append(item.finding(MISLABELLED, text, REMAKE))
    return size, findings, description


def _hashed(item: _Item) -> tuple[int, str]:
    """Return size and MD5 of a file, or of what git has in its place."""
    if item.path is not None:
        return item.path.stat().st_size, md5_of(item.path)
    if item.text is None:
        raise FileNotFoundError(item.where)
    return len(item.text), hashlib.md5(item.text, usedforsecurity=False).hexdigest()


def _opened(path: Path, kind: ProductKind, name: str, scratch: Path) -> Description:
    """Open a product as each of its readers does."""
    # Files of the cache lack the suffix by which the kind of a product is known.
    link = scratch / f"{kind.name}-{name}{kind.suffix}"
    link.symlink_to(path.resolve())
    try:
        products.verify(link)
        description = Description(products.read_description(link))
        if kind.suffix == TENSORS and description.attributes.get("format") == FORMAT:
            ObjectFile.load(link)
    except ObjectFolderError as error:
        raise FormatError(str(path), error.finding.replace(f"{link}: ", ""), error.remedy) from error
    except RecursionError as error:
        raise FormatError(str(path), "its attributes are too deep", REMAKE) from error
    finally:
        link.unlink(missing_ok=True)
    return description


def _restore(item: _Item, contents: Contents) -> str:
    """Return how to get a good copy of a file.

    DVC takes a file whose size and time are unchanged for undamaged, in the work tree as in its cache. So
    ``dvc checkout``, ``dvc pull`` and ``dvc repro`` bring back a file only after it was deleted.
    """
    folder = item.where.rpartition("/")[0] or item.where
    if not item.md5:
        return REMAKE
    near = contents.path(item.md5)
    if near is None:
        return f"Delete it where it is, then `dvc pull {folder}` if a remote has it, or run `dvc repro`."
    if near == item.path:
        return (
            f"Delete {near}, then `dvc fetch --all-commits`; or check that version out and run `dvc repro`."
        )
    if md5_of(near) == item.md5:
        return f"The cache has it: delete the file, then `dvc checkout {folder}`."
    remedy = f"delete the file and {near}, then `dvc pull {folder}`, or run `dvc repro`."
    return f"Its copy in the cache is damaged, too: {remedy}"


def _lineage(
    stages: Sequence[Stage], descriptions: Mapping[tuple[str, str], Description]
) -> Iterator[Finding]:
    """Compare the inputs that each product names with the products of the version."""
    made_by = {kind.name: (stage, kind) for stage in stages for kind in stage.products}
    for (name, object_id), description in descriptions.items():
        stage, kind = made_by[name]
        inputs = description.provenance.get("inputs")
        mismatches = []
        for product in stage.inputs:
            input_description = descriptions.get((product.kind.name, object_id))
            input_digest = inputs.get(product.kind.name) if isinstance(inputs, dict) else None
            if input_description is not None and input_digest != _digest(
                input_description, product.attributes
            ):
                mismatches.append(product.kind.name)
        if mismatches:
            where = f"{kind.folder}/{object_id}{kind.suffix}"
            finding = f"made from other {', '.join(mismatches)} than those beside it"
            yield Finding(where, MADE_FROM_ANOTHER, finding, "Run `dvc repro`.")


def _digest(description: Description, attributes: Sequence[str]) -> Any:
    if not attributes:
        return description.fingerprint
    try:
        return {
            name: reduce(operator.getitem, name.split("."), description.attributes) for name in attributes
        }
    except (KeyError, TypeError):
        return None
