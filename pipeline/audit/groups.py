"""Groups of objects that changed in the same way for the same reasons."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.audit.findings import (
    CHANGED,
    GONE,
    MADE,
    REMOVED,
    RENAMED,
    STATES,
    UNCHANGED,
    Audit,
    ObjectChange,
)  # fmt: skip
from pipeline.audit.reasons import CODE, PARAMETER, UPSTREAM, Reason
from pipeline.audit.reproducibility import DIFFERENT, EQUAL, WITHIN
from pipeline.audit.texts import printable
from pipeline.dataset.stages import STAGES

NAMED = 3  # modules, and parameters of one section, before the rest are counted
Texts = tuple[str, ...]


@dataclass(frozen=True)
class Group:
    """Objects with one state and the same reasons.

    Parameters
    ----------
    state
        One of `findings.STATES`.
    objects
        Them.
    reasons
        What each was made from that changed, in sentences.
    direct
        Stages that changed for these reasons.
    behind
        Stages that changed because of stages before them only.
    """

    state: str
    objects: tuple[ObjectChange, ...]
    reasons: tuple[str, ...]
    direct: tuple[str, ...]
    behind: tuple[str, ...]


@dataclass(frozen=True)
class StageTotal:
    """What happened in a stage, over all objects.

    Parameters
    ----------
    stage
        Its name.
    states
        How many products changed, were made and are gone.
    arrays
        How many arrays there are of each verdict.
    unread
        Products whose arrays were not compared.
    cpu_s
        What was spent on what is new, as far as it was noted.
    costed, made
        How many of the new products have a cost that is known, and how many there are.
    """

    stage: str
    states: Mapping[str, int]
    arrays: Mapping[str, int]
    unread: int
    cpu_s: float
    costed: int
    made: int

    @property
    def cells(self) -> list[str]:
        """Numbers of `COLUMNS` as texts, empty where there is nothing."""
        numbers = [self.states.get(state, 0) for state in (CHANGED, MADE, GONE)]
        numbers += [self.arrays.get(verdict, 0) for verdict in (EQUAL, WITHIN, DIFFERENT)]
        cost = f"{self.cpu_s:.1f}" if self.costed else "unknown" if self.made else ""
        return [*(str(number or "") for number in (*numbers, self.unread)), cost]


def groups(audit: Audit) -> list[Group]:
    """Return what changed, the largest groups of a state last: single objects are what one looks for."""
    found: dict[tuple[str, Texts, Texts, Texts, Texts], list[ObjectChange]] = defaultdict(list)
    for one in audit.objects:
        if one.state == UNCHANGED and not one.stages:
            continue
        failed: Texts = (f"{one.failed_stage}: {one.failure.error}",) if one.failure is not None else ()
        direct, behind = _stages(one)
        why = tuple(sentences(one.roots)) if one.state != REMOVED else ()
        found[one.state, failed, why, direct, behind].append(one)
    made = []
    for (state, failed, why, direct, behind), objects in found.items():
        reasons = tuple(printable(text) for text in (*failed, *why))
        made.append(Group(state, tuple(objects), reasons, direct, behind))
    return sorted(made, key=lambda one: (one.state, len(one.objects), one.objects[0].object_id))


def sentences(found: Sequence[Reason]) -> list[str]:
    """Return reasons as texts; many modules of code, or parameters of one section, in one."""
    texts = []
    together: dict[tuple[str, str], list[Reason]] = defaultdict(list)
    for one in found:
        section = one.name.rpartition(".")[0] if one.kind == PARAMETER else ""
        together[one.kind, section].append(one)
    for (kind, section), alike in together.items():
        rest = len(alike) - NAMED
        if kind == CODE and rest > 0:
            named = ", ".join(one.name for one in alike[:NAMED])
            texts.append(f"code {named} and {rest} more modules changed")
        elif kind == PARAMETER and rest > 1:
            texts += [*map(str, alike[:NAMED]), f"parameter {section}: {rest} more"]
        else:
            texts += map(str, alike)
    return texts


def counts(audit: Audit) -> str:
    """Return the number of objects of each state."""
    count = Counter(one.state for one in audit.objects)
    return ", ".join(f"{count[state]} {state}" for state in STATES if count[state]) or "none"


def names(found: Sequence[ObjectChange], most: int = 6) -> str:
    """Return ids with commas between them, the rest counted."""
    ids = [f"{one.was} -> {one.object_id}" if one.state == RENAMED else one.object_id for one in found]
    text = ", ".join(map(printable, ids[:most]))
    return text if len(ids) <= most else f"{text} and {len(ids) - most} more"


def totals(audit: Audit) -> list[StageTotal]:
    """Return what happened in each stage."""
    by_stage = defaultdict(list)
    for one in audit.objects:
        for change in one.stages:
            by_stage[change.stage].append(change)
    found = []
    for name in sorted(by_stage, key=list(STAGES).index):
        changes = by_stage[name]
        arrays: Counter[str] = Counter()
        for change in changes:
            arrays.update(change.arrays.count())
        made = [one for one in changes if one.new and one.new != one.old]
        known = [one.cpu_s for one in made if one.cpu_s is not None]
        found.append(
            StageTotal(
                name, Counter(one.state for one in changes), arrays,
                sum(one.arrays.unread for one in changes), sum(known), len(known), len(made),
            )
        )  # fmt: skip
    return found


def _stages(one: ObjectChange) -> tuple[tuple[str, ...], tuple[str, ...]]:
    direct: list[str] = []
    behind: list[str] = []
    for stage in one.stages:
        only_upstream = stage.reasons and all(reason.kind == UPSTREAM for reason in stage.reasons)
        (behind if only_upstream else direct).append(stage.stage)
    return tuple(direct), tuple(behind)
