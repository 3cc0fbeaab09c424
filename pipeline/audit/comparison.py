"""Two versions of the data set compared, object by object and stage by stage, on what products say."""

from collections.abc import Iterator, Sequence
from typing import Any

from objectfolder.errors import FormatError, ObjectFolderError
from pipeline.audit import reasons
from pipeline.audit.arrays import Arrays, by_checksums
from pipeline.audit.contents import Content, Contents
from pipeline.audit.costs import KnownCosts, to_fetch
from pipeline.audit.descriptions import Description, damage
from pipeline.audit.fidelity import FidelityChange, changes, worst_first
from pipeline.audit.findings import (
    ADDED,
    CHANGED,
    FAILED,
    GONE,
    MADE,
    MENDED,
    REMOVED,
    RENAMED,
    STILL_FAILED,
    UNCHANGED,
    Audit,
    ObjectChange,
    StageChange,
)
from pipeline.audit.outcomes import failures_of
from pipeline.audit.reasons import Circumstances, Reason
from pipeline.audit.renaming import renamed
from pipeline.audit.versions import Version
from pipeline.audit.whole import Suspects
from pipeline.dataset.products import ZARR, ProductKind
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import FIDELITY, OBJECTS, STAGES
from pipeline.dataset.task import Failure


class Comparison:
    """A comparison of two versions.

    Parameters
    ----------
    contents
        Where products are read from.
    old, new
        The versions.
    stages
        Each after those whose products it reads.
    read_arrays
        Read the arrays of changed products, rather than compare their checksums.
    """

    def __init__(
        self,
        contents: Contents,
        old: Version,
        new: Version,
        stages: Sequence[Stage] = tuple(STAGES.values()),
        read_arrays: bool = False,
    ) -> None:
        self._contents, self._old, self._new = contents, old, new
        self._stages = stages
        self._suspects = Suspects(contents, read_arrays)
        self._known = KnownCosts(contents.root, new)
        self._problems: dict[str, ObjectFolderError] = {}
        self._far: dict[str, Description | ObjectFolderError] = {}
        self._recent: dict[str, Description] = {}  # of the object that is looked at
        self._seeds = (old.lock.parameter("seed"), new.lock.parameter("seed"))
        self._compared = tuple(kind for stage in stages for kind in stage.products if self._is_known(kind))

    def audit(self) -> Audit:
        """Return what changed."""
        old, new = self._old, self._new
        self._fetch_descriptions()
        pairs = renamed(old, new, self._describe)
        former = {after: before for before, after in pairs.items()}
        failed_before = failures_of(old, self._stages)
        failed_after = failures_of(new, self._stages)
        found, fidelity = [], []
        for object_id in sorted((old.listed | new.listed) - set(pairs)):
            was = former.get(object_id, object_id)
            change, measures = self._object(
                was, object_id, failed_before.get(was), failed_after.get(object_id)
            )
            found.append(change)
            fidelity += measures
        return Audit(
            old.label, new.label, tuple(found), tuple(worst_first(fidelity)),
            to_fetch(self._contents, old, new), self._suspects.read_arrays, tuple(self._problems.values()),
        )  # fmt: skip

    def _object(
        self,
        was: str,
        object_id: str,
        before: tuple[str, Failure] | None,
        after: tuple[str, Failure] | None,
    ) -> tuple[ObjectChange, list[FidelityChange]]:
        self._recent.clear()
        around = self._circumstances(was, object_id)
        stages: list[StageChange] = []
        measures: list[FidelityChange] = []
        for stage in self._stages:
            pairs = [
                (kind, old, new)
                for kind in stage.products
                if kind in self._compared
                for old, new in [(self._old.content(kind, was), self._new.content(kind, object_id))]
                if (old and old.md5) != (new and new.md5)
            ]
            if not pairs:
                continue
            change, said = self._stage(stage, object_id, pairs, around)
            stages.append(change)
            if said is not None:
                measures += changes(object_id, *said)
        stage_name, failure = after or ("", None)
        state = self._state(was, object_id, before, after, bool(stages))
        former = was if was != object_id else ""
        found = ObjectChange(object_id, state, former, tuple(stages), failure, stage_name)
        return found, measures

    def _state(
        self, was: str, object_id: str, before: object | None, after: object | None, changed: bool
    ) -> str:
        if object_id not in self._new.listed:
            return REMOVED
        if after is not None:
            return STILL_FAILED if before is not None else FAILED
        if was not in self._old.listed:
            return ADDED
        if was != object_id:
            return RENAMED
        if before is not None:
            return MENDED
        return CHANGED if changed else UNCHANGED

    def _stage(
        self,
        stage: Stage,
        object_id: str,
        pairs: Sequence[tuple[ProductKind, Content | None, Content | None]],
        around: Circumstances,
    ) -> tuple[StageChange, tuple[Any, Any] | None]:
        """Compare the products of a stage that are not the same; the second is of fidelity."""
        why: list[Reason] = []
        arrays = Arrays()
        prints = ["", ""]
        said: tuple[Any, Any] | None = None
        for kind, old, new in pairs:
            before, after = self._described(old, why), self._described(new, why)
            for side, one in enumerate((before, after)):
                prints[side] = prints[side] or (one.fingerprint if one else "")
            if kind.name == FIDELITY.name:
                said = (before.attributes if before else None, after.attributes if after else None)
                if self._hides_fidelity(old, before) or self._hides_fidelity(new, after):
                    said = None
            if old is None or new is None or before is None or after is None:
                continue
            more = reasons.why(stage, before, after, around)
            suspicious = all(one.kind == reasons.BYTES for one in more)
            found, broken = (
                self._by_checksums(before, after) if kind.suffix == ZARR else (Arrays(unread=1), [])
            )
            if suspicious or self._suspects.read_arrays:
                read, defects = self._suspects.compare(stage, old, new, before, after)
                found = read or found
                more = [*defects, *more] if not (defects and suspicious) else defects
            if broken and all(one.kind != reasons.CORRUPTED for one in more):
                more = [*broken, *more]
            arrays += found
            why += [one for one in more if one not in why]
        # One product of a stage can be made from another thing, and the other be the same but damaged.
        if any(one.kind not in (reasons.BYTES, *reasons.DEFECTS) for one in why):
            why = [one for one in why if one.kind != reasons.BYTES]
        olds, news = ([pair[side] for pair in pairs] for side in (1, 2))
        state = MADE if not any(olds) else GONE if not any(news) else CHANGED
        cost = self._known.of(object_id, stage.name, prints[1]) if prints[1] != prints[0] else None
        return StageChange(stage.name, state, tuple(why), prints[0], prints[1], arrays, cost), said

    def _by_checksums(self, before: Description, after: Description) -> tuple[Arrays, list[Reason]]:
        """Compare two archives' lists of entries; a damaged one is a reason."""
        try:
            return by_checksums(before, after), []
        except ValueError:
            damages = [(which, damage(one.listing)) for which, one in (("earlier", before), ("later", after))]
        found = [
            Reason(reasons.CORRUPTED, note=f"the {which} one: {text}") for which, text in damages if text
        ]
        return Arrays(unread=1), found

    def _hides_fidelity(self, content: Content | None, found: Description | None) -> bool:
        return content is not None and found is None

    def _described(self, content: Content | None, why: list[Reason]) -> Description | None:
        """Return what a product says; a damaged or absent one is a reason."""
        if content is None:
            return None
        try:
            return self._describe(content)
        except FormatError as error:
            why.append(reasons.unreadable(error))
            if content.where.startswith(f"{FIDELITY.folder}/"):
                # What a damaged one measured is judged by no threshold.
                self._problems.setdefault(content.where, error)
        except ObjectFolderError as error:
            why.append(Reason(reasons.UNREADABLE, note=error.finding))
            self._problems.setdefault(error.finding, error)
        return None

    def _describe(self, content: Content) -> Description:
        known = self._far.get(content.md5) or self._recent.get(content.md5)
        if isinstance(known, ObjectFolderError):
            raise known
        if known is None:
            known = self._recent[content.md5] = self._contents.describe(content)
        return known

    def _fetch_descriptions(self) -> None:
        """Ask a remote for all that is not here at once: one after the other would take minutes."""
        wanted = list(self._differing())
        far = [content for content in wanted if not self._contents.is_near(content)]
        if far:
            self._far.update(self._contents.describe_all(far))

    def _differing(self) -> Iterator[Content]:
        for kind in self._compared:
            old, new = self._old.folders[kind.folder].products, self._new.folders[kind.folder].products
            for object_id in old.keys() | new.keys():
                pair = old.get(object_id), new.get(object_id)
                if (pair[0] and pair[0].md5) != (pair[1] and pair[1].md5):
                    yield from filter(None, pair)

    def _is_known(self, kind: ProductKind) -> bool:
        """Whether products of a kind need to be compared; not to know them is a problem, then."""
        old, new = self._old.folders[kind.folder], self._new.folders[kind.folder]
        if old.md5 and old.md5 == new.md5:
            return False
        for folder in (old, new):
            if folder.problem is not None:
                self._problems.setdefault(kind.folder, folder.problem)
        return old.problem is None and new.problem is None

    def _circumstances(self, was: str, object_id: str) -> Circumstances:
        before, after = self._old.rows.get(was, {}), self._new.rows.get(object_id, {})
        return Circumstances(
            self._seeds,
            (_name(before.get("material")), _name(after.get("material"))),
            (self._old.materials, self._new.materials),
            self._digests(was, object_id),
            was != object_id,
        )

    def _digests(self, was: str, object_id: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """What an object's shape and colour are in both versions, where that product changed."""
        if OBJECTS not in self._compared:
            return {}, {}
        old, new = self._old.content(OBJECTS, was), self._new.content(OBJECTS, object_id)
        if old is None or new is None or old.md5 == new.md5:
            return {}, {}
        try:
            before, after = (self._describe(one).attributes.get("digests") for one in (old, new))
        except ObjectFolderError:
            return {}, {}
        return (before, after) if isinstance(before, dict) and isinstance(after, dict) else ({}, {})


def _name(material: Any) -> str:
    name = material.get("name") if isinstance(material, dict) else None
    return name if isinstance(name, str) else ""
