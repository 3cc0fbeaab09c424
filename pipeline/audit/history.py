"""The versions of one object: at which commits its products changed, why, and what it did to fidelity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from objectfolder.errors import InputError, ObjectFolderError
from pipeline.audit.comparison import Comparison
from pipeline.audit.contents import Contents
from pipeline.audit.fidelity import MEASURES
from pipeline.audit.findings import ObjectChange, State, sentences
from pipeline.audit.git import Commit, GitRepository
from pipeline.audit.stores import NotHere
from pipeline.audit.versions import Version, made_nothing, read_version
from pipeline.dataset.lock_file import LOCK
from pipeline.dataset.partition_folders import FOLDER
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import FIDELITY

SHORT = 8
NOWHERE = "their lists of files are not in the cache, and no remote is set"
NAME_A_REMOTE = "Name the one that has them: `dvc remote add --default NAME URL`."
APPEARED, CHANGED, GONE, INCOMPLETE = "appeared", "changed", "gone", "incomplete"


@dataclass(frozen=True)
class ObjectVersion:
    """A commit at which products of an object changed.

    Attributes
    ----------
    state : `APPEARED`, `CHANGED`, `GONE`, or `INCOMPLETE` where it has some of its products only
    stages : the stages whose products changed
    fingerprints : of the products that changed and are there, by stage, short
    reasons : why, in sentences
    fidelity : measures by key; empty where the version has none, or it cannot be read here
    cpu_s : what making it anew took, as far as it was noted
    problems : what could not be read here
    """

    commit: Commit
    state: str
    stages: tuple[str, ...]
    fingerprints: Mapping[str, str] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()
    fidelity: Mapping[str, float] = field(default_factory=dict)
    cpu_s: float | None = None
    problems: tuple[str, ...] = ()

    @property
    def products(self) -> list[str]:
        """The stages, each with the fingerprint of its product."""
        return [f"{stage} {self.fingerprints.get(stage, '')}".rstrip() for stage in self.stages]


Unreadable = tuple[Commit, ObjectFolderError]


def history(
    contents: Contents, object_id: str, stages: Sequence[Stage], revision: str = "HEAD"
) -> tuple[list[ObjectVersion], list[Unreadable]]:
    """Return the versions of an object up to a revision, oldest first, and the commits not readable here.

    Only commits that changed ``dvc.lock`` are looked at, and of those only where products of the object
    changed, their attributes are read.

    Raises
    ------
    InputError
        No such revision, or no version has the object.
    NotHere
        No version can be read here, and no remote is set that may have them.
    """
    versions: list[ObjectVersion] = []
    unreadable: list[Unreadable] = []
    former, git = made_nothing(stages), GitRepository(contents.root)
    locks = [LOCK, *(f"{FOLDER}/{name}/{LOCK}" for name in git.names(revision, str(FOLDER)))]
    for commit in reversed(git.commits_of(locks, revision)):
        try:
            version = read_version(contents, stages, commit.hash, object_id)
            problem = next((folder.problem for folder in version.folders.values() if folder.problem), None)
        except ObjectFolderError as error:
            problem = error
        if problem is not None:
            unreadable.append((commit, problem))
            continue
        if _products(former, object_id) != _products(version, object_id):
            versions.append(_version(contents, object_id, stages, former, version, commit))
        former = version
    if unreadable and not versions and contents.remote is None:
        finding = f"none of the {len(unreadable)} versions can be read here: {NOWHERE}"
        raise NotHere(object_id, finding, NAME_A_REMOTE)
    if not versions and not unreadable:
        remedy = "Check the id; `git log -- dvc.lock` lists the versions."
        raise InputError(object_id, f"no version behind {revision} has it", remedy)
    return versions, unreadable


def _products(version: Version, object_id: str) -> dict[str, str]:
    """Return the hashes of an object's files in a version, by folder."""
    folders = version.folders.items()
    return {path: folder.products[object_id].md5 for path, folder in folders if object_id in folder.products}


def _version(
    contents: Contents, object_id: str, stages: Sequence[Stage], old: Version, new: Version, commit: Commit
) -> ObjectVersion:
    comparison = Comparison(contents, old, new, stages)
    stage_changes, _ = comparison.stages(object_id, object_id)
    seconds = [stage_change.cpu_s for stage_change in stage_changes if stage_change.cpu_s is not None]
    product_count = len(_products(new, object_id))
    state = CHANGED if _products(old, object_id) else APPEARED
    if product_count < len(new.folders):
        state = INCOMPLETE if product_count else GONE
    return ObjectVersion(
        commit,
        state,
        tuple(stage_change.stage for stage_change in stage_changes),
        {stage_change.stage: stage_change.new[:SHORT] for stage_change in stage_changes if stage_change.new},
        tuple(sentences(ObjectChange(object_id, State.CHANGED, stages=stage_changes).roots)),
        _fidelity(contents, new, object_id),
        sum(seconds) if seconds else None,
        tuple(map(str, comparison.problems)),
    )


def _fidelity(contents: Contents, version: Version, object_id: str) -> dict[str, float]:
    content = version.content(FIDELITY, object_id)
    try:
        attributes = contents.describe(content).attributes if content is not None else {}
    except ObjectFolderError:
        return {}  # the comparison has said so
    values = {key: measure.of(attributes) for key, measure in MEASURES.items()}
    return {key: value for key, value in values.items() if value is not None}
