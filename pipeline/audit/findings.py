"""The findings of an audit: on objects and stages, in groups of the same reasons, and in sums and words."""

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from objectfolder.errors import ObjectFolderError
from pipeline.audit.change_costs import Fetch
from pipeline.audit.fidelity import MEASURES, FidelityChange
from pipeline.audit.reasons import CODE, PARAMETER, UPSTREAM, distinct
from pipeline.audit.reproducibility import DIFFERENT, EQUAL, WITHIN, Arrays
from pipeline.dataset.counts import counted
from pipeline.dataset.differences import Reason
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.stages import STAGES

NAMED = 3  # modules, and parameters of one section, before the rest are counted
Texts = tuple[str, ...]
FIGURES = "its figures in the committed report; no product that could be compared changed"


class State(StrEnum):
    """What became of an object, or of its products of a stage (changed, made or gone).

    *Not made* is an object with neither a product nor a failure. *Not compared* is one of which nothing
    changed as far as could be read, and not all could.
    """

    ADDED = "added"
    REMOVED = "removed"
    RENAMED = "renamed"
    CHANGED = "changed"
    FAILED = "failed"
    STILL_FAILED = "failed as before"
    MENDED = "mended"
    NOT_MADE = "not made"
    NOT_COMPARED = "not compared"
    UNCHANGED = "unchanged"
    MADE = "made"
    GONE = "gone"


@dataclass(frozen=True)
class StageChange:
    """The change of an object's products of a stage.

    Parameters
    ----------
    reasons
        Why, for changed products.
    old, new
        Fingerprints; empty for a product without one.
    arrays
        What is known of the arrays without reading them, or after.
    cpu_s
        CPU seconds that it took to make, where they are known.
    """

    stage: str
    state: State
    reasons: tuple[Reason, ...] = ()
    old: str = ""
    new: str = ""
    arrays: Arrays = field(default_factory=Arrays)
    cpu_s: float | None = None

    @property
    def follows(self) -> bool:
        """Whether it changed only because earlier stages did."""
        return bool(self.reasons) and all(reason.kind == UPSTREAM for reason in self.reasons)


@dataclass(frozen=True)
class ObjectChange:
    """The change of an object.

    Parameters
    ----------
    was
        Its former id, where it was renamed.
    stages
        The stages whose products are not the same.
    failure
        Why it has not all products in the later version: the first stage that lacks one.
    """

    object_id: str
    state: State
    was: str = ""
    stages: tuple[StageChange, ...] = ()
    failure: FailedObject | None = None

    @property
    def roots(self) -> tuple[Reason, ...]:
        """Distinct reasons that do not follow from the change of another stage."""
        return tuple(
            distinct(reason for stage in self.stages for reason in stage.reasons if reason.kind != UPSTREAM)
        )


@dataclass(frozen=True)
class Audit:
    """All that an audit finds.

    Parameters
    ----------
    old, new
        Labels of the versions.
    objects
        Every object of either.
    fidelity
        Measures that changed, worst first.
    arrays_read
        Whether arrays were read, or only their checksums compared.
    problems
        What could not be read here, and what to do about it; an audit with any is incomplete.
    means
        Means over the objects that differ between the reports that git has.
    not_compared
        Folders of products of which the list of files could not be read in one of the versions.
    """

    old: str
    new: str
    objects: tuple[ObjectChange, ...]
    fidelity: tuple[FidelityChange, ...]
    fetch: Fetch
    arrays_read: bool
    problems: tuple[ObjectFolderError, ...] = ()
    means: tuple[FidelityChange, ...] = ()
    not_compared: Texts = ()


@dataclass(frozen=True)
class Group:
    """Objects with one state, the same reasons (in sentences), and the same stages that changed.

    Stages in `direct` changed for these reasons, those `behind` because of stages before them only.
    """

    state: str
    reasons: Texts
    direct: Texts
    behind: Texts
    objects: tuple[ObjectChange, ...]

    @property
    def title(self) -> str:
        """State, and number of objects."""
        return f"{self.state} ({len(self.objects)})" if len(self.objects) > 1 else self.state

    @property
    def places(self) -> str:
        """Stages that changed."""
        direct, behind = f"in {', '.join(self.direct)}", f"{UPSTREAM} of {', '.join(self.behind)}"
        return "; ".join([direct] * bool(self.direct) + [behind] * bool(self.behind))


@dataclass(frozen=True)
class StageTotal:
    """What happened in a stage, over all objects.

    Parameters
    ----------
    states, arrays
        Number of products of each state, and of arrays of each verdict.
    unread
        Products whose arrays were not compared.
    cpu_s, costed, products
        CPU seconds of the new products whose cost is known, their number, and that of all new products.
    """

    stage: str
    states: Counter[str]
    arrays: Counter[str]
    unread: int
    cpu_s: float
    costed: int
    products: int

    @property
    def cells(self) -> list[str]:
        """Its row of a table, empty where there is nothing."""
        numbers = [self.states[state] for state in (State.CHANGED, State.MADE, State.GONE)]
        numbers += [self.arrays[verdict] for verdict in (EQUAL, WITHIN, DIFFERENT)]
        cost = f"{self.cpu_s:.1f}" if self.costed else "unknown" if self.products else ""
        return [*(str(number or "") for number in (*numbers, self.unread)), cost]


def groups(audit: Audit) -> list[Group]:
    """Return the changes in groups, the smallest of a state first: a reader looks for single objects."""
    objects_by_key: dict[tuple[str, Texts, Texts, Texts], list[ObjectChange]] = defaultdict(list)
    for entry in audit.objects:
        if entry.state in (State.UNCHANGED, State.NOT_COMPARED) and not entry.stages:
            continue
        errors = [f"{entry.failure.stage}: {entry.failure.error}"] if entry.failure is not None else []
        why = sentences(entry.roots) if entry.state != State.REMOVED else []
        if entry.state == State.CHANGED and not entry.stages:
            why = [FIGURES]
        behind = tuple(change.stage for change in entry.stages if change.follows)
        direct = tuple(change.stage for change in entry.stages if not change.follows)
        objects_by_key[entry.state, (*errors, *why), direct, behind].append(entry)
    all_groups = [Group(*key, tuple(objects)) for key, objects in objects_by_key.items()]
    return sorted(all_groups, key=lambda group: (group.state, len(group.objects), group.objects[0].object_id))


def sentences(reasons: Sequence[Reason]) -> list[str]:
    """Return reasons as texts; many changed modules, or parameters of one section, are joined in one."""
    texts = []
    together: dict[tuple[str, str], list[Reason]] = defaultdict(list)
    for reason in reasons:
        section = reason.name.rpartition(".")[0] if reason.kind == PARAMETER else ""
        together[reason.kind, section].append(reason)
    for (kind, section), alike in together.items():
        rest = len(alike) - NAMED
        if kind == CODE and rest > 0:
            first_names = ", ".join(reason.name for reason in alike[:NAMED])
            texts.append(f"code {first_names} and {rest} more modules changed")
        elif kind == PARAMETER and rest > 1:
            texts += [*map(str, alike[:NAMED]), f"parameter {section}: {rest} more"]
        else:
            texts += map(str, alike)
    return texts


def totals(audit: Audit) -> list[StageTotal]:
    """Return what happened in each stage."""
    stage_totals = []
    for name in STAGES:
        changes = [change for entry in audit.objects for change in entry.stages if change.stage == name]
        if not changes:
            continue
        new_products = [product for product in changes if product.new and product.new != product.old]
        costs = [product.cpu_s for product in new_products if product.cpu_s is not None]
        arrays = Counter(verdict for product in changes for verdict in product.arrays.verdicts.values())
        unread = sum(product.arrays.unread for product in changes)
        states = Counter[str](product.state for product in changes)
        stage_totals.append(
            StageTotal(name, states, arrays, unread, sum(costs), len(costs), len(new_products))
        )
    return stage_totals


def counts(audit: Audit) -> str:
    """Return the number of objects of each state."""
    count = Counter(entry.state for entry in audit.objects)
    return numbered({state: count[state] for state in State if count[state]}) or "none"


def numbered(counts: Mapping[str, int]) -> str:
    """Return counts as text, as in ``3 equal, 1 different``."""
    return ", ".join(f"{count} {name}" for name, count in counts.items())


def names(changes: Sequence[ObjectChange], most: int) -> str:
    """Return ids separated by commas; ids beyond `most` are only counted."""
    ids = [
        f"{entry.was} -> {entry.object_id}" if entry.state == State.RENAMED else entry.object_id
        for entry in changes
    ]
    text = ", ".join(ids[:most])
    return text if len(ids) <= most else f"{text} and {len(ids) - most} more"


def value(measure: str, number: float | None) -> str:
    """Return a measure's value for people."""
    if number is None:
        return "none"
    decimals = MEASURES[measure].decimals + 1 if MEASURES[measure].unit != "bytes" else 0
    return f"{number:.{decimals}f}"


def change(figure: FidelityChange) -> str:
    """Return by how much a measure changed, for people."""
    if figure.before is None or figure.after is None:
        return "lost" if math.isinf(figure.loss) and figure.loss > 0 else "new"
    loss = value(figure.measure, abs(figure.loss))
    if not loss.strip("0."):
        loss = f"{abs(figure.loss):.1g}"  # less than the decimals that the measure is printed with
    return f"{'worse' if figure.loss > 0 else 'better'} by {loss}"


def cost(stage_totals: Sequence[StageTotal]) -> str:
    """Return the CPU seconds of the new products."""
    products, costed = (
        sum(total.products for total in stage_totals),
        sum(total.costed for total in stage_totals),
    )
    if not products:
        return "nothing"
    if not costed:
        return f"{counted(products, 'product')}; what they took is not noted here"
    sum_s = sum(total.cpu_s for total in stage_totals)
    return f"{counted(products, 'product')} in {sum_s:.0f} CPU s" + (
        f" (known of {costed})" if costed < products else ""
    )
