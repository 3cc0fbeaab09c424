"""The versions of one object: at which commits its products changed, why, and what it did to fidelity."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from objectfolder.errors import FormatError, InputError, ObjectFolderError
from pipeline.audit import reasons
from pipeline.audit.contents import Content, Contents
from pipeline.audit.costs import KnownCosts
from pipeline.audit.descriptions import Description
from pipeline.audit.fidelity import MEASURES
from pipeline.audit.git import Commit, GitRepository
from pipeline.audit.groups import sentences
from pipeline.audit.lock_file import LOCK, Lock, read_lock
from pipeline.audit.reasons import Circumstances, Reason
from pipeline.audit.versions import TEXTS, Version
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import FIDELITY, OBJECTS

AT_A_TIME = 64  # commits whose lock files are in memory
SHORT = 8
APPEARED, CHANGED, GONE, INCOMPLETE = "appeared", "changed", "gone", "incomplete"


@dataclass(frozen=True)
class ObjectVersion:
    """A commit at which products of an object changed.

    Parameters
    ----------
    commit
        Which commit.
    state
        `APPEARED`, `CHANGED`, `GONE`, or `INCOMPLETE` where it has some of its products only.
    stages
        The stages whose products changed.
    fingerprints
        Of the products that changed and are there, by stage, short.
    reasons
        Why, in sentences.
    fidelity
        Measures by key; empty where the version has none, or it cannot be read here.
    cpu_s
        What making it anew took, as far as it was noted.
    problems
        What could not be read here.
    """

    commit: Commit
    state: str
    stages: tuple[str, ...]
    fingerprints: Mapping[str, str] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()
    fidelity: Mapping[str, float] = field(default_factory=dict)
    cpu_s: float | None = None
    problems: tuple[str, ...] = ()


Products = Mapping[str, Content]  # by folder
Unreadable = tuple[Commit, ObjectFolderError]


def history(
    git: GitRepository, contents: Contents, object_id: str, stages: Sequence[Stage], revision: str = "HEAD"
) -> tuple[list[ObjectVersion], list[Unreadable]]:
    """Return the versions of an object, oldest first, and the commits that cannot be read here.

    Only commits that changed ``dvc.lock`` are looked at, and of those only where products of the object
    changed, their attributes are read.

    Parameters
    ----------
    git, contents
        Where versions are read from.
    object_id
        The object.
    stages
        All stages.
    revision
        The last commit to be looked at.

    Raises
    ------
    InputError
        No such revision, or no version has the object.
    """
    found: list[ObjectVersion] = []
    unreadable: list[Unreadable] = []
    former: tuple[Commit | None, Products] = (None, {})
    for commit, lock, products in _products(git, contents, object_id, stages, revision, unreadable):
        before, old = former
        hashes = [{path: one.md5 for path, one in held.items()} for held in (old, products)]
        if hashes[0] == hashes[1]:
            continue
        found.append(_version(git, contents, object_id, stages, (before, commit), (old, products), lock))
        former = commit, products
    if not found and not unreadable:
        remedy = "Check the id; `git log -- dvc.lock` lists the versions."
        raise InputError(object_id, f"no version behind {revision} has it", remedy)
    return found, unreadable


def _products(
    git: GitRepository,
    contents: Contents,
    object_id: str,
    stages: Sequence[Stage],
    revision: str,
    unreadable: list[Unreadable],
) -> Iterator[tuple[Commit, Lock, Products]]:
    """Yield what each version has of an object, oldest first; what cannot be read goes to `unreadable`."""
    commits = git.commits_of(LOCK, revision)[::-1]
    folders: dict[str, Mapping[str, str]] = {}
    for begin in range(0, len(commits), AT_A_TIME):
        some = commits[begin : begin + AT_A_TIME]
        texts = git.read_many((commit.hash, LOCK) for commit in some)
        for commit in some:
            text = texts[commit.hash, LOCK]
            try:
                lock = read_lock(LOCK, text) if text is not None else Lock()
                products = {}
                for kind in (kind for stage in stages for kind in stage.products):
                    out = lock.outs.get(kind.folder)
                    if out is None or not out.is_folder:
                        continue
                    if out.md5 not in folders:
                        folders[out.md5] = _of(contents.folder(out.md5, kind.folder), object_id)
                    name = f"{object_id}{kind.suffix}"
                    if name in folders[out.md5]:
                        md5 = folders[out.md5][name]
                        products[kind.folder] = Content(md5, kind.suffix, f"{kind.folder}/{name}")
            except ObjectFolderError as error:
                unreadable.append((commit, error))
                continue
            yield commit, lock, products


def _of(files: Mapping[str, str], object_id: str) -> dict[str, str]:
    """The files of one object: folders of a thousand at a thousand versions would not fit into memory."""
    return {name: md5 for name, md5 in files.items() if name.startswith(object_id)}


def _version(
    git: GitRepository,
    contents: Contents,
    object_id: str,
    stages: Sequence[Stage],
    commits: tuple[Commit | None, Commit],
    products: tuple[Products, Products],
    lock: Lock,
) -> ObjectVersion:
    before, commit = commits
    old, new = products
    problems: list[str] = []

    def described(held: Products, path: str) -> Description | None:
        if path not in held:
            return None
        try:
            return contents.describe(held[path])
        except ObjectFolderError as error:
            problems.append(str(error))
            return None

    versions = [_light(git, one, lock if one is commit else None) for one in (before, commit)]
    around = _circumstances(object_id, versions, [described(held, OBJECTS.folder) for held in products])
    costs = KnownCosts(contents.root, versions[1])
    changed, why, prints, seconds = [], list[Reason](), dict[str, str](), list[float]()
    for stage in stages:
        for kind in stage.products:
            path = kind.folder
            hashes = [held[path].md5 if path in held else None for held in products]
            if hashes[0] == hashes[1]:
                continue
            changed.append(stage.name)
            first, second = described(old, path), described(new, path)
            if second is not None and stage.name not in prints:
                prints[stage.name] = second.fingerprint[:SHORT]
                cost = costs.of(object_id, stage.name, second.fingerprint)
                seconds += [cost] if cost is not None else []
            if first is not None and second is not None:
                why += [one for one in reasons.why(stage, first, second, around) if one not in why]
    roots = [one for one in why if one.kind != reasons.UPSTREAM]
    measured = described(new, FIDELITY.folder)
    return ObjectVersion(
        commit,
        _state(old, new, stages),
        tuple(dict.fromkeys(changed)),
        prints,
        tuple(sentences(roots)),
        _fidelity(measured),
        sum(seconds) if seconds else None,
        tuple(dict.fromkeys(problems)),
    )


def _state(old: Products, new: Products, stages: Sequence[Stage]) -> str:
    if not new:
        return GONE
    if len(new) < sum(len(stage.products) for stage in stages):
        return INCOMPLETE
    return CHANGED if old else APPEARED


def _light(git: GitRepository, commit: Commit | None, lock: Lock | None) -> Version:
    """A version without its products: what explains them."""
    if commit is None:
        return Version("", None, Lock(), {}, {})
    found = git.read_many((commit.hash, path) for path in TEXTS)
    texts = {path: text for (_, path), text in found.items() if text is not None}
    if lock is None:
        try:
            lock = read_lock(LOCK, texts.get(LOCK, b""))
        except FormatError:
            lock = Lock()
    return Version(commit.hash, commit, lock, texts, {})


def _circumstances(
    object_id: str, versions: Sequence[Version], objects: Sequence[Description | None]
) -> Circumstances:
    materials, digests = [], []
    for version, described in zip(versions, objects, strict=True):
        material = version.rows.get(object_id, {}).get("material")
        materials.append(str(material.get("name", "")) if isinstance(material, dict) else "")
        said = described.attributes.get("digests") if described is not None else None
        digests.append(said if isinstance(said, dict) else {})
    first, second = versions
    return Circumstances(
        (first.lock.parameter("seed"), second.lock.parameter("seed")),
        (materials[0], materials[1]),
        (first.materials, second.materials),
        (digests[0], digests[1]),
    )


def _fidelity(found: Description | None) -> dict[str, float]:
    if found is None:
        return {}
    values = {key: measure.of(found.attributes) for key, measure in MEASURES.items()}
    return {key: value for key, value in values.items() if value is not None}
