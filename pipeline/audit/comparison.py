"""Compares two versions of the data set, object by object and stage by stage, by attributes of products."""

from collections.abc import Iterator, Sequence
from typing import Any

from objectfolder.errors import FormatError, ObjectFolderError
from pipeline.audit import reasons
from pipeline.audit.arrays import Arrays
from pipeline.audit.change_costs import KnownCosts, to_fetch
from pipeline.audit.contents import Content, Contents
from pipeline.audit.descriptions import Description
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
from pipeline.audit.product_comparison import ProductComparison
from pipeline.audit.reasons import Circumstances, Reason
from pipeline.audit.renaming import renamed
from pipeline.audit.versions import Version
from pipeline.dataset.products import ProductKind
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import FIDELITY, OBJECTS, STAGES


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
        self._products = ProductComparison(contents, read_arrays)
        self._known = KnownCosts(contents.root, new)
        self._problems: dict[str, ObjectFolderError] = {}  # by what they hide
        self._compared = tuple(kind for stage in stages for kind in stage.products if self._is_known(kind))

    @property
    def problems(self) -> tuple[ObjectFolderError, ...]:
        """What could not be read so far."""
        return tuple(self._problems.values())

    def audit(self) -> Audit:
        """Return what changed."""
        old, new = self._old, self._new
        for damage in (old.damage, new.damage):
            if damage is not None:
                raise damage
        # Asked of a remote one after the other, these would take minutes.
        self._contents.describe_all(self._differing())
        pairs = renamed(old, new, self._contents.describe)
        former = {after: before for before, after in pairs.items()}
        failed_before, failed_after = old.failures(self._stages), new.failures(self._stages)
        found, fidelity = [], []
        for object_id in sorted((old.listed | new.listed) - set(pairs)):
            was = former.get(object_id, object_id)
            stages, measures = self.stages(was, object_id)
            stage_name, failure = failed_after.get(object_id, ("", None))
            state = self._state(was, object_id, failed_before.get(was), failure, bool(stages))
            found.append(
                ObjectChange(object_id, state, former.get(object_id, ""), stages, failure, stage_name)
            )
            fidelity += measures
        return Audit(
            old.label, new.label, tuple(found), tuple(worst_first(fidelity)),
            to_fetch(self._contents, old, new), self._products.read_arrays, self.problems,
        )  # fmt: skip

    def stages(self, was: str, object_id: str) -> tuple[tuple[StageChange, ...], list[FidelityChange]]:
        """Return the stages whose products of an object changed, and what that did to fidelity.

        Parameters
        ----------
        was, object_id
            Its id in the earlier and in the later version.
        """
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
            change, more = self._stage(stage, object_id, pairs, around)
            stages.append(change)
            measures += more
        return tuple(stages), measures

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
    ) -> tuple[StageChange, list[FidelityChange]]:
        """Compare the products of a stage that are not the same."""
        why: list[Reason] = []
        arrays = Arrays()
        prints = ["", ""]
        measures: list[FidelityChange] = []
        for kind, old, new in pairs:
            before, after = self._described(old, why), self._described(new, why)
            for side, one in enumerate((before, after)):
                prints[side] = prints[side] or (one.fingerprint if one else "")
            # An unreadable product may have any fidelity, an absent one has none.
            if kind.name == FIDELITY.name and (before or not old) and (after or not new):
                measures = changes(
                    object_id, before.attributes if before else None, after.attributes if after else None
                )
            if old and new and before and after:
                found, more = self._products.compare(stage, (old, new), (before, after), around)
                arrays += found
                why += [one for one in more if one not in why]
        # One product of a stage can be made from another thing, and the other be the same but damaged.
        if any(one.kind not in (reasons.BYTES, *reasons.DEFECTS) for one in why):
            why = [one for one in why if one.kind != reasons.BYTES]
        olds, news = ([pair[side] for pair in pairs] for side in (1, 2))
        state = MADE if not any(olds) else GONE if not any(news) else CHANGED
        cost = self._known.of(object_id, stage.name, prints[1]) if prints[1] != prints[0] else None
        return StageChange(stage.name, state, tuple(why), prints[0], prints[1], arrays, cost), measures

    def _described(self, content: Content | None, why: list[Reason]) -> Description | None:
        """Return the description of a product; a damaged or absent product is a reason."""
        if content is None:
            return None
        try:
            return self._contents.describe(content)
        except FormatError as error:
            why.append(Reason(reasons.CORRUPTED, note=error.finding))
            if content.where.startswith(f"{FIDELITY.folder}/"):
                # What a damaged one measured is judged by no threshold.
                self._problems.setdefault(content.where, error)
        except ObjectFolderError as error:
            why.append(Reason(reasons.UNREADABLE, note=error.finding))
            self._problems.setdefault(error.finding, error)
        return None

    def _differing(self) -> Iterator[Content]:
        for kind in self._compared:
            old, new = self._old.folders[kind.folder].products, self._new.folders[kind.folder].products
            for object_id in old.keys() | new.keys():
                pair = old.get(object_id), new.get(object_id)
                if (pair[0] and pair[0].md5) != (pair[1] and pair[1].md5):
                    yield from filter(None, pair)

    def _is_known(self, kind: ProductKind) -> bool:
        """Whether products of a kind are to be compared; an unreadable list of them is noted as a problem."""
        old, new = self._old.folders[kind.folder], self._new.folders[kind.folder]
        if old.md5 and old.md5 == new.md5:
            return False
        for folder in (old, new):
            if folder.problem is not None:
                self._problems.setdefault(kind.folder, folder.problem)
        return old.problem is None and new.problem is None

    def _circumstances(self, was: str, object_id: str) -> Circumstances:
        old, new = self._old, self._new
        return Circumstances(
            (old.lock.parameter("seed"), new.lock.parameter("seed")),
            (old.material(was), new.material(object_id)),
            (old.materials, new.materials),
            self._digests(was, object_id),
            was != object_id,
        )

    def _digests(self, was: str, object_id: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the shape and colour of an object in both versions, where that product changed."""
        if OBJECTS not in self._compared:
            return {}, {}
        old, new = self._old.content(OBJECTS, was), self._new.content(OBJECTS, object_id)
        if old is None or new is None or old.md5 == new.md5:
            return {}, {}
        try:
            before, after = (self._contents.describe(one).attributes.get("digests") for one in (old, new))
        except ObjectFolderError:
            return {}, {}
        return (before, after) if isinstance(before, dict) and isinstance(after, dict) else ({}, {})
