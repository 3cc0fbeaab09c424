"""A version of the data set: which objects it lists, and the content of every product, by hash."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from objectfolder.errors import FormatError, InputError, ObjectFolderError
from objectfolder.products.regular_file import require_regular
from pipeline.audit.contents import Content, Contents
from pipeline.audit.git import Commit, GitRepository
from pipeline.dataset.failures import FAILURES, FailedObject, parse_failures
from pipeline.dataset.lock_file import LOCK, Lock, is_folder, read_lock
from pipeline.dataset.products import ProductKind
from pipeline.dataset.records import MATERIALS, RECORDS, Records, parse_records
from pipeline.dataset.stage import Stage

WORK_TREE = "work tree"
PER_OBJECT, METRICS = "reports/per_object.csv", "reports/metrics.json"
NOT_KEPT = "no product; this version does not say why"
LOOK = "See runs/ where that version was made, or run it again: `dvc repro`."
TEXTS = (
    LOCK, RECORDS.as_posix(), MATERIALS.as_posix(), FAILURES.as_posix(), PER_OBJECT, METRICS,
)  # fmt: skip


@dataclass(frozen=True)
class Folder:
    """Products of a kind in a version.

    Attributes
    ----------
    md5 : of the whole folder, where it is known without looking at its files; two with the same hold the same
    products : content by object id
    problem : why `products` is not known
    made : whether the version has the folder at all
    """

    md5: str = ""
    products: Mapping[str, Content] = field(default_factory=dict)
    problem: ObjectFolderError | None = None
    made: bool = True


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
    """

    commit: Commit | None
    lock: Lock
    texts: Mapping[str, bytes]
    folders: Mapping[str, Folder]
    damage: FormatError | None = None

    @property
    def label(self) -> str:
        """For people."""
        return WORK_TREE if self.commit is None else f"{self.commit.short} {self.commit.subject[:60]}"

    @cached_property
    def records(self) -> Records:
        """Records of the objects it lists, empty ones where the version has no record of them."""
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
        text = self.texts.get(FAILURES.as_posix(), b"[]")
        return {(failure.stage, failure.object): failure for failure in parse_failures(text)}

    @cached_property
    def not_made(self) -> frozenset[str]:
        """Ids of objects with neither a product nor a failure: not selected, or the run did not end."""
        if FAILURES.as_posix() not in self.texts or any(folder.problem for folder in self.folders.values()):
            return frozenset()
        failed = {object_id for _, object_id in self.reported}
        with_products = {object_id for folder in self.folders.values() for object_id in folder.products}
        return frozenset(self.rows) - failed - with_products

    def content(self, kind: ProductKind, object_id: str) -> Content | None:
        """Return the content of a product; None for an absent one."""
        return self.folders[kind.folder].products.get(object_id)

    def lying(self, folder: str) -> set[str]:
        """Return the hashes of the files in a folder of the work tree; none for a commit."""
        products = self.folders.get(folder, Folder()).products
        return {content.md5 for content in products.values() if content.path is not None}

    def failures(self, stages: Sequence[Stage]) -> dict[str, FailedObject]:
        """Return, by object id, the first stage of which a product is missing, and why.

        A stage that the version does not have at all, or whose products are not known here, says nothing.
        """
        refused = self.records.refused
        failures = {failure.object_id: FailedObject.of(stages[0].name, failure) for failure in refused}
        for stage in stages:
            folders = [self.folders[kind.folder] for kind in stage.products]
            if not all(folder.made and folder.problem is None for folder in folders):
                continue
            for object_id in self.rows.keys() - self.not_made:
                if not all(object_id in folder.products for folder in folders):
                    unknown = FailedObject(object_id, stage.name, NOT_KEPT, LOOK)
                    failures.setdefault(object_id, self.reported.get((stage.name, object_id), unknown))
        return failures


def read_version(contents: Contents, stages: Sequence[Stage], revision: str | None) -> Version:
    """Return the version of a git revision, or of the work tree for None.

    Raises
    ------
    InputError
        No such revision, or no data set was made there.
    FormatError
        A revision's ``dvc.lock`` that is none.
    """
    if revision is None:
        return _work_tree(contents, stages)
    git = GitRepository(contents.root)
    commit = git.commit(revision)
    texts = _texts(git, commit, TEXTS)
    if LOCK not in texts:
        remedy = "Name a version whose data set was made and committed: `git log -- dvc.lock` lists them."
        raise InputError(f"{revision} ({commit.short})", f"it has no {LOCK}", remedy)
    lock = read_lock(f"{LOCK} of {revision}", texts[LOCK])
    # Outputs that DVC does not cache are in git, and so is the table of objects.
    more = [path for path, md5 in lock.outs.items() if not is_folder(md5)]
    texts |= _texts(git, commit, [*more, lock.table])
    folders = {kind.folder: _locked(contents, lock, kind) for stage in stages for kind in stage.products}
    return Version(commit, lock, texts, folders)


def _work_tree(contents: Contents, stages: Sequence[Stage]) -> Version:
    """Return the version of the work tree; an absent folder counts as ``dvc.lock`` says."""
    root = contents.root
    texts = {path: (root / path).read_bytes() for path in TEXTS if (root / path).is_file()}
    lock, damage = Lock(), None
    if LOCK in texts:
        try:
            lock = read_lock(LOCK, texts[LOCK])
        except FormatError as error:
            damage = error
    kinds = [kind for stage in stages for kind in stage.products]
    folders = {
        kind.folder: _lying(contents, kind)
        if (root / kind.folder).is_dir()
        else _locked(contents, lock, kind)
        for kind in kinds
    }
    if LOCK not in texts and not any(folder.products for folder in folders.values()):
        finding = f"there is no {LOCK} and no product"
        raise InputError(WORK_TREE, finding, "Run `dvc repro` or `make dataset`.")
    return Version(None, lock, texts, folders, damage)


def _texts(git: GitRepository, commit: Commit, paths: Sequence[str]) -> dict[str, bytes]:
    texts = {path: git.read(commit.hash, path) for path in paths if path}
    return {path: text for path, text in texts.items() if text is not None}


def _locked(contents: Contents, lock: Lock, kind: ProductKind) -> Folder:
    """Products of a kind as a ``dvc.lock`` names them."""
    folder = lock.outs.get(kind.folder)
    if folder is None:
        return Folder(made=False)
    try:
        files = contents.folder(folder, kind.folder) if is_folder(folder) else {}
    except (ObjectFolderError, OSError) as error:
        problem = error if isinstance(error, ObjectFolderError) else FormatError(kind.folder, str(error))
        return Folder(folder, problem=problem)
    products = {
        name.removesuffix(kind.suffix): Content(md5, kind.suffix, f"{kind.folder}/{name}")
        for name, md5 in files.items()
        if name.endswith(kind.suffix) and "/" not in name
    }
    return Folder(folder, products)


def _lying(contents: Contents, kind: ProductKind) -> Folder:
    """Products of a kind in the work tree; files that DVC's state does not know are hashed."""
    from dvc_data.hashfile.hash import hash_file
    from dvc_objects.fs.local import localfs

    products = {}
    for object_id in kind.object_ids(contents.root):
        path = kind.path(contents.root, object_id)
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
    folders = {kind.folder: Folder(made=False) for stage in stages for kind in stage.products}
    return Version(None, Lock(), {}, folders)
