"""A version of the data set: which objects it lists, and the content of every product, by hash.

The version of a checkout whose products lie in partitions joins those of its partitions.
"""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, InputError, ObjectFolderError
from objectfolder.products.regular_file import require_regular
from pipeline.audit.contents import Content, Contents
from pipeline.audit.git import Commit, GitRepository
from pipeline.dataset.failures import FAILURES, FailedObject, parse_failures
from pipeline.dataset.lock_file import LOCK, Lock, is_folder, read_lock
from pipeline.dataset.partition_folders import FOLDER, NAME, folders, inside, partition_number
from pipeline.dataset.products import ProductKind
from pipeline.dataset.records import MATERIALS, RECORDS, Records, parse_records
from pipeline.dataset.stage import Stage

WORK_TREE = "work tree"
PER_OBJECT, METRICS = "reports/per_object.csv", "reports/metrics.json"
NOT_KEPT = "no product; this version does not say why"
LOOK = "See runs/ where that version was made, or run it again: `dvc repro`."
TEXTS = (LOCK, RECORDS.as_posix(), FAILURES.as_posix(), PER_OBJECT, METRICS)


@dataclass(frozen=True)
class Folder:
    """Products of a kind in a version.

    Attributes
    ----------
    md5 : of the whole folder, where it is known without looking at its files; two with the same hold the same
    products : content by object id
    problem : why `products` is not known
    exists : whether the version has the folder at all
    """

    md5: str = ""
    products: Mapping[str, Content] = field(default_factory=dict)
    problem: ObjectFolderError | None = None
    exists: bool = True


@dataclass(frozen=True)
class Version:
    """A commit, or the work tree.

    Attributes
    ----------
    commit : none for the work tree
    lock : its ``dvc.lock``
    texts : small files that are versioned by git: `TEXTS`, and of a commit also outputs that DVC does not
        cache
    folders : products by the folder of their kind
    damage : what is wrong with the ``dvc.lock`` of the work tree; it is read as an empty one, then
    partitions : of a long table; paths in `lock` are then those of the checkout, and `texts` are those of the
        checkout and, by their paths in it, those of the partitions
    """

    commit: Commit | None
    lock: Lock
    texts: Mapping[str, bytes]
    folders: Mapping[str, Folder]
    damage: FormatError | None = None
    partitions: tuple["Version", ...] = ()

    @property
    def data_sets(self) -> tuple["Version", ...]:
        """The versions of the folders with products: of the partitions, else this one."""
        return self.partitions or (self,)

    @property
    def label(self) -> str:
        """For people."""
        return WORK_TREE if self.commit is None else f"{self.commit.short} {self.commit.subject[:60]}"

    @cached_property
    def records(self) -> Records:
        """Records of the objects it lists, empty ones where the version has no record of them."""
        if self.partitions:
            records = [version.records for version in self.partitions]
            rows = {object_id: row for record in records for object_id, row in record.rows.items()}
            return Records(rows, tuple(failure for record in records for failure in record.refused))
        try:
            return parse_records(self.texts.get(RECORDS.as_posix(), b""))
        except InputError:
            folders = self.folders.values()
            return Records({object_id: {} for folder in folders for object_id in folder.products})

    @property
    def rows(self) -> Mapping[str, Mapping[str, Any]]:
        """Records of the objects that the table's check did not refuse."""
        return self.records.rows

    @cached_property
    def listed(self) -> frozenset[str]:
        """Ids of all objects it was to make."""
        return self.records.listed

    @cached_property
    def materials(self) -> Mapping[str, Mapping[str, str]]:
        """Rows of its table of materials by name."""
        text = self.texts.get(MATERIALS.as_posix(), b"").decode(errors="replace")
        return {row.get("name") or "": row for row in csv.DictReader(io.StringIO(text))}

    def material(self, object_id: str) -> str:
        """Return the name of an object's material; empty where the version does not say."""
        material = self.rows.get(object_id, {}).get("material")
        return str(material.get("name") or "") if isinstance(material, dict) else ""

    @cached_property
    def reported(self) -> Mapping[tuple[str, str], FailedObject]:
        """Failures by stage and object, by ``data/failures.json``; none where there is no such file."""
        if self.partitions:
            return {key: failure for version in self.partitions for key, failure in version.reported.items()}
        text = self.texts.get(FAILURES.as_posix(), b"[]")
        return {(failure.stage, failure.object): failure for failure in parse_failures(text)}

    @cached_property
    def not_made(self) -> frozenset[str]:
        """Ids of objects with neither a product nor a failure: not selected, or the run did not end."""
        if self.partitions:
            return frozenset().union(*(version.not_made for version in self.partitions))
        if FAILURES.as_posix() not in self.texts or any(folder.problem for folder in self.folders.values()):
            return frozenset()
        ids = {object_id for _, object_id in self.reported}
        with_products = {object_id for folder in self.folders.values() for object_id in folder.products}
        return frozenset(self.rows) - ids - with_products

    def content(self, kind: ProductKind, object_id: str) -> Content | None:
        """Return the content of a product; None for an absent one."""
        return self.folders[kind.folder].products.get(object_id)

    @cached_property
    def lying(self) -> Mapping[str, set[str]]:
        """The hashes of the products in each folder of the work tree that has any; none for a commit."""
        hashes: dict[str, set[str]] = {}
        for content in (content for folder in self.folders.values() for content in folder.products.values()):
            if content.path is not None:
                hashes.setdefault(content.where.rpartition("/")[0], set()).add(content.md5)
        return hashes

    def failures(self, stages: Sequence[Stage]) -> dict[str, FailedObject]:
        """Return, by object id, the first stage of which a product is missing, and why.

        A stage that the version does not have at all, or whose products are not known here, says nothing.
        """
        if self.partitions:
            parts = [version.failures(stages) for version in self.partitions]
            return {object_id: failure for failures in parts for object_id, failure in failures.items()}
        refused = self.records.refused
        failures = {failure.object_id: FailedObject.of(stages[0].name, failure) for failure in refused}
        for stage in stages:
            folders = [self.folders[kind.folder] for kind in stage.products]
            if not all(folder.exists and folder.problem is None for folder in folders):
                continue
            for object_id in self.rows.keys() - self.not_made:
                if not all(object_id in folder.products for folder in folders):
                    unknown = FailedObject(object_id, stage.name, NOT_KEPT, LOOK)
                    failures.setdefault(object_id, self.reported.get((stage.name, object_id), unknown))
        return failures


def read_version(
    contents: Contents, stages: Sequence[Stage], revision: str | None, object_id: str = ""
) -> Version:
    """Return the version of a git revision, or of the work tree for None.

    Where products lie in partitions, it joins those of all, or has those of the partition of `object_id`.

    Raises
    ------
    InputError
        No such revision, or no data set was made there.
    FormatError
        A revision's ``dvc.lock`` that is none.
    """
    commit = None if revision is None else GitRepository(contents.root).commit(revision)
    names = _partitions(contents, commit)
    if object_id and names:
        names = [names[partition_number(object_id, len(names))]]
    checkout = _data_set(contents, () if names else stages, commit)
    versions = {place: _data_set(contents, stages, commit, place) for place in names}
    if not any(map(_is_made, versions.values() or [checkout])):
        if commit is None:
            finding, remedy = f"there is no {LOCK} and no product", "Run `dvc repro` or `make dataset`."
            raise InputError(WORK_TREE, finding, remedy)
        remedy = "Name a version whose data set was made and committed: `git log -- dvc.lock` lists them."
        raise InputError(f"{revision} ({commit.short})", f"it has no {LOCK}", remedy)
    return _joined(contents, checkout, versions) if names else checkout


def _partitions(contents: Contents, commit: Commit | None) -> list[str]:
    """Return the folders of partitions, each with a slash at its end."""
    if commit is None:
        names = [folder.name for folder in folders(contents.root)]
    else:
        entries = GitRepository(contents.root).names(commit.hash, str(FOLDER))
        names = sorted(name for name in entries if NAME.fullmatch(name))
    return [f"{FOLDER}/{name}/" for name in names]


def _is_made(version: Version) -> bool:
    lies = version.commit is None and any(folder.products for folder in version.folders.values())
    return LOCK in version.texts or lies


def _data_set(contents: Contents, stages: Sequence[Stage], commit: Commit | None, place: str = "") -> Version:
    """Return the version of a folder of the checkout; what does not lie in the work tree is as locked."""
    texts = _texts(contents, commit, TEXTS, place) | _texts(contents, commit, [MATERIALS.as_posix()])
    lock, damage = Lock(), None
    if LOCK in texts:
        where = f"{place}{LOCK}" if commit is None else f"{place}{LOCK} of {commit.short}"
        try:
            lock = read_lock(where, texts[LOCK])
        except FormatError as error:
            if commit is not None:
                raise
            damage = error
    if commit is not None:
        # Outputs that DVC does not cache are in git, and so is the table of objects.
        more = [path for path, md5 in lock.outs.items() if not is_folder(md5)]
        texts |= _texts(contents, commit, [*more, lock.table], place)
    products = {
        kind.folder: _lying(contents, kind, place)
        if commit is None and (contents.root / place / kind.folder).is_dir()
        else _locked(contents, lock, kind, place)
        for stage in stages
        for kind in stage.products
    }
    return Version(commit, lock, texts, products, damage)


def _joined(contents: Contents, checkout: Version, versions: Mapping[str, Version]) -> Version:
    """Return the version of a checkout with that of each of its partitions by folder."""
    commit, partitions = checkout.commit, tuple(versions.values())
    common = _texts(contents, commit, [LOCK, Path(METRICS).name], f"{FOLDER}/")
    texts = {path: text for path, text in checkout.texts.items() if path not in TEXTS}
    texts |= {METRICS: common[Path(METRICS).name]} if Path(METRICS).name in common else {}
    texts |= {
        f"{place}{path}": text for place, version in versions.items() for path, text in version.texts.items()
    }
    outs = {f"{place}{path}": md5 for place, own in versions.items() for path, md5 in own.lock.outs.items()}
    # Of the checkout's lock, what is not of the time before there were partitions.
    inner = set(map(inside, outs))
    outs |= {path: md5 for path, md5 in checkout.lock.outs.items() if path not in inner}
    inputs = read_lock(f"{FOLDER}/{LOCK}", common[LOCK]).parameters if LOCK in common else {}
    paths = (f"{place}{path}" for place, own in versions.items() for path in own.lock.paths)
    lock = Lock(outs, {**partitions[0].lock.parameters, **inputs}, checkout.lock.paths.union(paths))
    texts |= _texts(contents, commit, [lock.table])
    whole = {
        name: _joined_folder([own.folders[name] for own in partitions]) for name in partitions[0].folders
    }
    damage = next((version.damage for version in partitions if version.damage), None)
    return Version(commit, lock, texts, whole, damage, partitions)


def _joined_folder(folders: Sequence[Folder]) -> Folder:
    digests = [folder.md5 for folder in folders]
    return Folder(
        " ".join(digests) if all(digests) else "",
        {object_id: content for folder in folders for object_id, content in folder.products.items()},
        next((folder.problem for folder in folders if folder.problem), None),
        any(folder.exists for folder in folders),
    )


def _texts(
    contents: Contents, commit: Commit | None, paths: Iterable[str], place: str = ""
) -> dict[str, bytes]:
    """Return those of the files that a commit or the work tree has in a folder of the checkout."""
    if commit is None:
        folder = contents.root / place
        return {path: (folder / path).read_bytes() for path in paths if path and (folder / path).is_file()}
    git = GitRepository(contents.root)
    texts = {path: git.read(commit.hash, f"{place}{path}") for path in paths if path}
    return {path: text for path, text in texts.items() if text is not None}


def _locked(contents: Contents, lock: Lock, kind: ProductKind, place: str) -> Folder:
    """Products of a kind as the ``dvc.lock`` of a folder of the checkout names them."""
    folder = lock.outs.get(kind.folder)
    if folder is None:
        return Folder(exists=False)
    where = f"{place}{kind.folder}"
    try:
        files = contents.folder(folder, where) if is_folder(folder) else {}
    except (ObjectFolderError, OSError) as error:
        problem = error if isinstance(error, ObjectFolderError) else FormatError(where, str(error))
        return Folder(folder, problem=problem)
    products = {
        name.removesuffix(kind.suffix): Content(md5, kind.suffix, f"{where}/{name}")
        for name, md5 in files.items()
        if name.endswith(kind.suffix) and "/" not in name
    }
    return Folder(folder, products)


def _lying(contents: Contents, kind: ProductKind, place: str) -> Folder:
    """Products of a kind in a folder of the work tree; files that DVC's state does not know are hashed."""
    from dvc_data.hashfile.hash import hash_file
    from dvc_objects.fs.local import localfs

    root = contents.root / place
    products = {}
    for object_id in kind.object_ids(root):
        path = kind.path(root, object_id)
        where = path.relative_to(contents.root).as_posix()
        try:
            require_regular(path)
            _, digest = hash_file(str(path), localfs, "md5", state=contents.repository.state)
        except OSError as error:
            return Folder(
                problem=FormatError(where, f"cannot be read ({error.strerror})", "Check its permissions.")
            )
        products[object_id] = Content(str(digest.value), kind.suffix, where, path)
    return Folder("", products)


def made_nothing(stages: Sequence[Stage]) -> Version:
    """Return an empty version, as before the first: without objects or products."""
    folders = {kind.folder: Folder(exists=False) for stage in stages for kind in stage.products}
    return Version(None, Lock(), {}, folders)
