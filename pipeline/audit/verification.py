"""Every file of a version read whole: hash, own checksums, fingerprint, and what it was made from."""

import hashlib
import operator
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, ObjectFolderError
from objectfolder.object_file import FORMAT, ObjectFile
from pipeline.audit.contents import FETCH, Contents
from pipeline.audit.descriptions import Description
from pipeline.audit.reasons import is_labelled_truly
from pipeline.audit.versions import Version
from pipeline.dataset import products
from pipeline.dataset.products import TENSORS, ProductKind
from pipeline.dataset.stage import Stage

AT_ONCE = 4  # files read at the same time: disks and hashes, not processors, are what is waited for
DAMAGED, OTHER, MISSING, UNLISTED, MISLABELLED, MADE_FROM_ANOTHER = (
    "damaged", "other content", "missing", "not listed", "mislabelled", "made from another",
)  # fmt: skip
REMAKE = "Run `dvc repro`: what is damaged is made again."
Progress = Callable[[int, int, int], None]


@dataclass(frozen=True)
class Finding:
    """What is wrong with a file.

    Parameters
    ----------
    where
        Its path in the version.
    kind
        One of the words above.
    finding, remedy
        What is wrong, and what to do.
    """

    where: str
    kind: str
    finding: str
    remedy: str


@dataclass(frozen=True)
class Verified:
    """What was looked at, and what is wrong.

    Parameters
    ----------
    files, bytes
        That were read.
    findings
        None of which there should be.
    """

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
    told: dict[tuple[str, str], Description] = {}
    done = read = 0
    with ThreadPoolExecutor(AT_ONCE) as pool, tempfile.TemporaryDirectory(prefix="objectfolder-") as scratch:
        checked = pool.map(lambda item: _check(item, contents, version, Path(scratch)), items)
        for item, (size, found, description) in zip(items, checked, strict=True):
            done, read = done + 1, read + size
            findings += found
            if description is not None and item.kind is not None:
                told[item.kind.name, item.object_id] = description
            progress(done, len(items), read)
    findings += _lineage(stages, told)
    return Verified(done, read, tuple(sorted(findings, key=lambda one: (one.where, one.kind))))


def _items(
    contents: Contents, version: Version, stages: Sequence[Stage]
) -> tuple[list[_Item], list[Finding]]:
    kinds = {kind.folder: kind for stage in stages for kind in stage.products}
    items: list[_Item] = []
    findings: list[Finding] = []
    lying = version.commit is None
    for path, out in sorted(version.lock.outs.items()):
        if not out.is_folder:
            items.append(_single(contents, version, path, out.md5))
            continue
        listing = contents.path(out.md5)
        if listing is not None:
            items.append(_Item(f"{path} (its list of files in the cache)", out.md5[:32], listing))
        try:
            files = contents.folder(out.md5, path)
        except ObjectFolderError as error:
            findings.append(Finding(path, MISSING, error.finding, error.remedy))
            continue
        if lying and not (contents.root / path).is_dir():
            finding = f"none of its {len(files)} files lie there"
            findings.append(Finding(path, MISSING, finding, f"`dvc pull {path}`, or `dvc checkout {path}`."))
            continue
        for name, md5 in sorted(files.items()):
            place = contents.root / path / name if lying else contents.path(md5)
            kind = kinds.get(path)
            object_id = name.removesuffix(kind.suffix) if kind is not None else ""
            items.append(_Item(f"{path}/{name}", md5, place, kind, object_id))
        if lying and path in kinds:
            for object_id, content in version.folders[path].products.items():
                if f"{object_id}{kinds[path].suffix}" not in files:
                    items.append(_Item(content.where, "", content.path, kinds[path], object_id))
    for folder, kind in kinds.items():
        if lying and folder not in version.lock.outs:
            for object_id, content in version.folders[folder].products.items():
                items.append(_Item(content.where, "", content.path, kind, object_id))
    return items, findings


def _single(contents: Contents, version: Version, path: str, md5: str) -> _Item:
    if version.commit is None:
        return _Item(path, md5, contents.root / path)
    # What DVC does not cache is in git.
    return _Item(path, md5, contents.path(md5), text=version.texts.get(path))


def _check(
    item: _Item, contents: Contents, version: Version, scratch: Path
) -> tuple[int, list[Finding], Description | None]:
    """Return bytes read, what is wrong, and what the product says of itself."""
    if item.path is None or not item.path.is_file():
        if item.text is not None:
            return len(item.text), list(_hash_finding(item, hashlib.md5(item.text), contents)), None
        if item.path is None and not item.kind and version.commit is not None:
            finding = "neither in the cache nor in git"
            return 0, [Finding(item.where, MISSING, finding, FETCH)], None
        return 0, [Finding(item.where, MISSING, "there is no such file", _restore(item, contents))], None
    try:
        size = item.path.stat().st_size
        with item.path.open("rb") as file:
            digest = hashlib.file_digest(file, "md5")
    except OSError as error:
        finding = f"cannot be read ({error.strerror})"
        return 0, [Finding(item.where, DAMAGED, finding, "See the disk and its access rights.")], None
    found = list(_hash_finding(item, digest, contents))
    if item.kind is None:
        return size, found, None
    try:
        description = _opened(item.path, item.kind, item.md5 or item.object_id, scratch)
    except (ObjectFolderError, OSError) as error:
        text = error.finding if isinstance(error, ObjectFolderError) else str(error)
        # One finding a file: that it is not what the list says follows from its damage.
        return size, [Finding(item.where, DAMAGED, text, _restore(item, contents))], None
    if not is_labelled_truly(description):
        finding = "its fingerprint is not that of the parts it names"
        found.append(Finding(item.where, MISLABELLED, finding, f"Delete it. {REMAKE}"))
    return size, found, description


def _hash_finding(item: _Item, digest: Any, contents: Contents) -> Iterator[Finding]:
    found = digest.hexdigest()
    if not item.md5:
        remedy = "Run `dvc repro`, or `dvc commit` if it is meant to be."
        yield Finding(item.where, UNLISTED, "whole, but dvc.lock does not list it", remedy)
    elif found != item.md5:
        finding = f"its MD5 is {found}, the version lists {item.md5}"
        yield Finding(item.where, OTHER, finding, _restore(item, contents))


def _opened(path: Path, kind: ProductKind, name: str, scratch: Path) -> Description:
    """Open a product in every way there is.

    Raises
    ------
    FormatError
        A damaged one.
    """
    # Files of the cache have no suffix, by which products are told apart.
    named = scratch / f"{kind.name}-{name}{kind.suffix}"
    named.symlink_to(path.resolve())
    try:
        products.verify(named)
        description = Description(products.read_description(named))
        if kind.suffix == TENSORS and description.attributes.get("format") == FORMAT:
            ObjectFile.load(named)
    except ObjectFolderError as error:
        raise FormatError(str(path), error.finding.replace(f"{named}: ", ""), error.remedy) from error
    except RecursionError as error:
        raise FormatError(str(path), "its attributes are too deep", REMAKE) from error
    finally:
        named.unlink(missing_ok=True)
    return description


def _restore(item: _Item, contents: Contents) -> str:
    """Return where a good copy of a file is, as what to do."""
    near = contents.path(item.md5) if item.md5 else None
    if near is not None and near != item.path:
        with near.open("rb") as file:
            if hashlib.file_digest(file, "md5").hexdigest() == item.md5:
                folder = item.where.rpartition("/")[0] or item.where
                return f"The cache has it: `dvc checkout --force {folder}`."
        return f"Its copy in the cache is damaged, too: delete {near}, then `dvc pull --force`. Or: {REMAKE}"
    if near is not None:
        return f"Delete {near}, then `dvc fetch --all-commits`. Or check that version out: {REMAKE}"
    return f"`dvc pull` if a remote has it. Or: {REMAKE}"


def _lineage(stages: Sequence[Stage], told: Mapping[tuple[str, str], Description]) -> Iterator[Finding]:
    """Compare what each product was made from with what the version has."""
    wrong: dict[tuple[ProductKind, str], list[str]] = defaultdict(list)
    for stage in stages:
        for kind in stage.products:
            for (name, object_id), description in told.items():
                if name != kind.name:
                    continue
                inputs = description.provenance.get("inputs")
                for product in stage.inputs:
                    there = told.get((product.kind.name, object_id))
                    said = inputs.get(product.kind.name) if isinstance(inputs, dict) else None
                    if there is not None and said != _digest(there, product.attributes):
                        wrong[kind, object_id].append(product.kind.name)
    for (kind, object_id), names in wrong.items():
        where = f"{kind.folder}/{object_id}{kind.suffix}"
        finding = f"made from other {', '.join(names)} than lie beside it"
        yield Finding(where, MADE_FROM_ANOTHER, finding, "Run `dvc repro`.")


def _digest(found: Description, attributes: Sequence[str]) -> Any:
    if not attributes:
        return found.fingerprint
    try:
        return {name: reduce(operator.getitem, name.split("."), found.attributes) for name in attributes}
    except (KeyError, TypeError):
        return None
