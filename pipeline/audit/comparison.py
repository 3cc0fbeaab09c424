"""Compares two versions of the data set, object by object and stage by stage, by attributes of products."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

from objectfolder.errors import FormatError, ObjectFolderError
from objectfolder.products.provenance import canonical_json
from pipeline.audit import reasons
from pipeline.audit.change_costs import reported_costs, to_fetch
from pipeline.audit.committed_figures import changes_of_means, figures_by_object
from pipeline.audit.contents import Content, Contents
from pipeline.audit.descriptions import Description
from pipeline.audit.fidelity import FidelityChange, changes, worst_first
from pipeline.audit.findings import Audit, ObjectChange, StageChange, State
from pipeline.audit.product_comparison import ProductComparison
from pipeline.audit.reasons import Circumstances
from pipeline.audit.reproducibility import Arrays
from pipeline.audit.versions import METRICS, Version
from pipeline.dataset.differences import Reason
from pipeline.dataset.products import ProductKind
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import FIDELITY, OBJECTS, STAGES
from pipeline.run.costs import costs_by_fingerprint

Pair = tuple[Content | None, Content | None]


class Comparison:
    """A comparison of two versions; with `read_arrays`, also of the arrays of changed products."""

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
        self._measured, self._reported = costs_by_fingerprint(contents.root), reported_costs(new)
        self._problems: dict[str, ObjectFolderError] = {}  # by what they hide
        kinds = [kind for stage in stages for kind in stage.products]
        comparable = {kind: self._is_known(kind) for kind in kinds}
        self._not_compared = tuple(kind.folder for kind in kinds if not comparable[kind])
        self._compared = [kind for kind in kinds if comparable[kind] and not self._is_same(kind)]

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
        pairs = _renamed(self._contents, old, new)
        former = {after: before for before, after in pairs.items()}
        failed_before, failed_after = old.failures(self._stages), new.failures(self._stages)
        figures = figures_by_object(old), figures_by_object(new)
        object_changes, fidelity = [], []
        for object_id in sorted((old.listed | new.listed) - set(pairs)):
            was = former.get(object_id, object_id)
            stages, measures = self.stages(was, object_id)
            if not measures and figures[0] is not None and figures[1] is not None:
                measures = changes(object_id, figures[0].get(was), figures[1].get(object_id))
            fidelity += measures
            failure = failed_after.get(object_id)
            if object_id not in new.listed:
                state = State.REMOVED
            elif failure is not None:
                state = State.STILL_FAILED if was in failed_before else State.FAILED
            elif object_id in new.not_made:
                state = State.NOT_MADE
            elif was not in old.listed or was in old.not_made:
                state = State.ADDED
            elif was != object_id:
                state = State.RENAMED
            elif was in failed_before:
                state = State.MENDED
            elif stages or measures:
                state = State.CHANGED
            else:
                state = State.NOT_COMPARED if self._not_compared else State.UNCHANGED
            object_changes.append(ObjectChange(object_id, state, former.get(object_id, ""), stages, failure))
        means = changes_of_means(old.texts.get(METRICS), new.texts.get(METRICS))
        return Audit(
            old.label, new.label, tuple(object_changes), tuple(worst_first(fidelity)),
            to_fetch(self._contents, old, new), self._products.read_arrays, self.problems,
            tuple(worst_first(means)), self._not_compared,
        )  # fmt: skip

    def stages(self, was: str, object_id: str) -> tuple[tuple[StageChange, ...], list[FidelityChange]]:
        """Return the stages whose products of an object (formerly `was`) changed, and their fidelity."""
        by_kind = {kind: pair for kind in self._compared if (pair := self._pair(kind, was, object_id))}
        if not by_kind:
            return (), []
        around = Circumstances(
            (self._old.lock.parameter("seed"), self._new.lock.parameter("seed")),
            (self._old.material(was), self._new.material(object_id)),
            (self._old.materials, self._new.materials),
            self._digests(by_kind.get(OBJECTS)),
            was != object_id,
        )
        stages: list[StageChange] = []
        measures: list[FidelityChange] = []
        for stage in self._stages:
            pairs = {kind: by_kind[kind] for kind in stage.products if kind in by_kind}
            if pairs:
                change, more = self._stage(stage, object_id, pairs, around)
                stages.append(change)
                measures += more
        return tuple(stages), measures

    def _pair(self, kind: ProductKind, was: str, object_id: str) -> Pair | None:
        """Return the products of an object in both versions; None where they are the same."""
        old, new = self._old.content(kind, was), self._new.content(kind, object_id)
        return (old, new) if (old and old.md5) != (new and new.md5) else None

    def _stage(
        self, stage: Stage, object_id: str, pairs: dict[ProductKind, Pair], around: Circumstances
    ) -> tuple[StageChange, list[FidelityChange]]:
        """Compare the products of a stage that are not the same."""
        why: list[Reason] = []
        arrays = Arrays()
        prints = ["", ""]
        measures: list[FidelityChange] = []
        for kind, (old, new) in pairs.items():
            before, after = self._described(old, why), self._described(new, why)
            for side, description in enumerate((before, after)):
                prints[side] = prints[side] or (description.fingerprint if description else "")
            # An unreadable product may have any fidelity, an absent one has none.
            if kind.name == FIDELITY.name and (before or not old) and (after or not new):
                measures = changes(
                    object_id, before.attributes if before else None, after.attributes if after else None
                )
            if old and new and before and after:
                verdicts, more = self._products.compare(stage, (old, new), (before, after), around)
                arrays += verdicts
                why = reasons.distinct([*why, *more])
        # One product of a stage can be made from another thing, and the other be the same but damaged.
        if any(reason.kind not in (reasons.BYTES, *reasons.DEFECTS) for reason in why):
            why = [reason for reason in why if reason.kind != reasons.BYTES]
        olds, news = zip(*pairs.values(), strict=True)
        state = State.MADE if not any(olds) else State.GONE if not any(news) else State.CHANGED
        cost_s = None
        if prints[1] != prints[0]:
            cost = self._measured.get(prints[1])
            cost_s = cost.cpu_s if cost else self._reported.get((object_id, stage.name))
        return StageChange(stage.name, state, tuple(why), prints[0], prints[1], arrays, cost_s), measures

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
                yield from filter(None, self._pair(kind, object_id, object_id) or ())

    def _is_same(self, kind: ProductKind) -> bool:
        """Whether the folder of a kind is the same in both, by its hash."""
        old, new = self._old.folders[kind.folder], self._new.folders[kind.folder]
        return bool(old.md5) and old.md5 == new.md5

    def _is_known(self, kind: ProductKind) -> bool:
        """Whether products of a kind can be compared; an unreadable list of them is noted as a problem."""
        if self._is_same(kind):
            return True
        old, new = self._old.folders[kind.folder], self._new.folders[kind.folder]
        for folder in (old, new):
            if folder.problem is not None:
                self._problems.setdefault(kind.folder, folder.problem)
        return old.problem is None and new.problem is None

    def _digests(self, by_kind: Pair | None) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the digests of geometry and texture in both versions, if that product changed."""
        old, new = by_kind or (None, None)
        if old is None or new is None:
            return {}, {}
        try:
            before, after = (
                self._contents.describe(content).attributes.get("digests") for content in (old, new)
            )
        except ObjectFolderError:
            return {}, {}
        return (before, after) if isinstance(before, dict) and isinstance(after, dict) else ({}, {})


def _renamed(contents: Contents, old: Version, new: Version) -> dict[str, str]:
    """Map former to later ids of objects that are read from the same files; equal materials match first."""
    old_ids, new_ids = sorted(old.listed - new.listed), sorted(new.listed - old.listed)
    if not old_ids or not new_ids:
        return {}
    by_files: dict[str, list[str]] = defaultdict(list)
    for object_id in old_ids:
        if key := _files(contents, old, object_id):
            by_files[key].append(object_id)
    files_by_id = {object_id: _files(contents, new, object_id) for object_id in new_ids}
    pairs: dict[str, str] = {}
    for fields in (("material", "name"), ("material",), ()):
        for object_id in new_ids:
            if object_id in pairs.values():
                continue
            row = new.rows.get(object_id, {})
            for old_id in by_files.get(files_by_id[object_id], ()):
                former = old.rows.get(old_id, {})
                if old_id not in pairs and all(former.get(name) == row.get(name) for name in fields):
                    pairs[old_id] = object_id
                    break
    return pairs


def _files(contents: Contents, version: Version, object_id: str) -> str:
    """Return digests of the files an object is read from; empty where they are not known."""
    content = version.content(OBJECTS, object_id)
    try:
        inputs = content and contents.describe(content).provenance.get("inputs")
        return canonical_json(inputs) if inputs else ""
    except (ObjectFolderError, TypeError, ValueError, RecursionError):
        return ""
