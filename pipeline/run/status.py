"""``objectfolder status``: which products are as the inputs ask for, which are not, and why.

Only attributes of products are read, and those only where a file changed since it was last read. Whether
a product is whole is for the next run to see, which reads changed ones through.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, InputError
from objectfolder.products.provenance import canonical_json, fingerprint
from pipeline.dataset.counts import columns
from pipeline.dataset.differences import Reason, differences
from pipeline.dataset.failures import FailedObject, read_failures
from pipeline.dataset.parameters import Parameters, read_parameters
from pipeline.dataset.products import read_description
from pipeline.dataset.records import read_table
from pipeline.dataset.selection import read_selection
from pipeline.dataset.stage import Row, Stage
from pipeline.dataset.stages import MODES, OBJECTS, STAGES
from pipeline.dataset.verified import FINGERPRINT, Verified
from pipeline.run.exclusive import owner
from pipeline.run.partitions import require_whole

CURRENT, STALE, MISSING, FAILED, WAITING, UNLISTED = (
    "current", "stale", "missing", "failed", "waiting", "unlisted",
)  # fmt: skip
STATES = (CURRENT, STALE, MISSING, FAILED, WAITING, UNLISTED)
NAMED = 4  # objects named in a line of the table before the rest are counted
LINES = 40  # of reasons in the table


@dataclass(frozen=True)
class Status:
    """The state of the products of an object in a stage.

    Attributes
    ----------
    object_id, stage : which
    state : ``current``; ``stale`` (made from something else); ``missing``; ``failed`` (in the last run, from
        the inputs of now); ``waiting`` (for an input that is not `current`, so that nothing is known of the
        product); ``unlisted`` (no longer in the table: the next run removes it)
    reasons : why, for people
    differences : what a stale product was made from and what is wanted
    warnings : what a product that is current says of its object, such as walls that cannot be so
    wanted : fingerprint that the inputs ask for; empty where an input is missing
    """

    object_id: str
    stage: str
    state: str
    reasons: tuple[str, ...] = ()
    differences: tuple[Reason, ...] = ()
    warnings: tuple[str, ...] = ()
    wanted: str = ""

    def as_mapping(self) -> dict[str, Any]:
        """Return what JSON takes; ``asdict`` copies each text."""
        return {**vars(self), "differences": list(map(asdict, self.differences))}


def status(
    root: Path,
    stages: Sequence[Stage] = tuple(STAGES.values()),
    parameters: Parameters | None = None,
    rows: Mapping[str, Row] | None = None,
) -> list[Status]:
    """Return the state of every object in every stage, each after those whose products it reads.

    Parameters and rows are those of ``params.yaml`` and the table that it names where they are not given.

    Raises
    ------
    InputError
        ``params.yaml``, the table of objects or ``data/failures.json`` cannot be used.
    """
    parameters = parameters or read_parameters(root / "params.yaml")
    refusals: dict[str, str] = {}
    ids = frozenset(rows or ())
    if rows is None:
        require_whole(root)
        records = read_table(root, parameters.objects)
        ids = records.listed
        records = records.selected(read_selection(root))
        rows = records.rows
        refusals = {failure.object_id: failure.error for failure in records.refused}
    products_seen = Verified(root, momentary=True)
    failures = {(failure.object, failure.stage): failure for failure in read_failures(root)}
    entries = [Status(object_id, stages[0].name, FAILED, (error,)) for object_id, error in refusals.items()]
    for object_id, row in rows.items():
        behind: set[str] = set()  # stages of this object that are not current
        for stage in stages:
            entry = _of(stage, root, parameters, object_id, row, products_seen, behind, failures)
            if entry.state != CURRENT:
                behind.add(stage.name)
            entries.append(entry)
    for stage in stages:
        present = {object_id for kind in stage.products for object_id in kind.object_ids(root)}
        entries += [Status(object_id, stage.name, UNLISTED) for object_id in sorted(present - ids)]
    if owner(root) is None:
        products_seen.save()
    return entries


def _of(
    stage: Stage,
    root: Path,
    parameters: Parameters,
    object_id: str,
    row: Row,
    products_seen: Verified,
    behind: set[str],
    failures: Mapping[tuple[str, str], FailedObject],
) -> Status:
    waits = tuple(f"waits for {name}" for name in sorted(stage.follows & behind))
    try:
        prepared = stage.prepare(root, parameters, object_id, row, products_seen)
    except InputError as error:
        if waits:
            return Status(object_id, stage.name, WAITING, waits)
        return Status(object_id, stage.name, FAILED, (f"{error.where}: {error.finding}",))
    fingerprint_now = fingerprint(prepared.parts)
    say = partial(Status, object_id, stage.name, wanted=fingerprint_now)
    targets = stage.targets(root, object_id)
    fingerprints: list[str] = []
    for path in targets:
        try:
            fingerprints.append(products_seen.attributes(path, (FINGERPRINT,))[FINGERPRINT])
        except FileNotFoundError:
            if waits:
                return Status(object_id, stage.name, WAITING, waits)
            failure = failures.get((object_id, stage.name))
            if failure and failure.fingerprint == fingerprint_now:
                return say(FAILED, (failure.error,))
            return say(MISSING)
        except FormatError as error:
            return say(STALE, (f"unreadable: {error.finding}",))
    if all(value == fingerprint_now for value in fingerprints):
        warnings = _warnings(stage, targets[0], products_seen)
        return say(WAITING if waits else CURRENT, waits, warnings=warnings)
    stale = next(path for path, value in zip(targets, fingerprints, strict=True) if value != fingerprint_now)
    changes = _differences(stale, prepared.parts)
    return say(STALE, tuple(map(str, changes)), changes)


def _warnings(stage: Stage, path: Path, products_seen: Verified) -> tuple[str, ...]:
    """Attributes of a cleaned mesh and of modes that are shown; other products repeat them or have none."""
    if OBJECTS not in stage.products and MODES not in stage.products:
        return ()
    try:
        words = products_seen.attributes(path, ("warnings",))["warnings"]
    except FormatError:
        return ()
    return tuple(text for text in words if isinstance(text, str)) if isinstance(words, list) else ()


def _differences(path: Path, parts: Mapping[str, Any]) -> tuple[Reason, ...]:
    try:
        old = read_description(path).get("provenance", {})
    except (FileNotFoundError, FormatError):
        old = {}
    old = json.loads(old) if isinstance(old, str) else old
    return tuple(differences(old, json.loads(canonical_json(parts))))


def table(statuses: Sequence[Status]) -> str:
    """Return counts of every stage, and reasons, objects that share one together."""
    stages = list(dict.fromkeys(entry.stage for entry in statuses))
    states = [state for state in STATES if any(entry.state == state for entry in statuses)] or [CURRENT]
    counts = Counter((entry.stage, entry.state) for entry in statuses)
    rows = [(stage, *(str(counts[stage, state] or "") for state in states)) for stage in stages]
    lines = columns([("stage", *states), *rows])
    reasons: dict[tuple[str, str], list[str]] = defaultdict(list)
    doubts: dict[tuple[str, str], list[str]] = defaultdict(list)
    for entry in statuses:
        if entry.state not in (CURRENT, WAITING):
            why = f" ({'; '.join(entry.reasons)})" if entry.reasons else ""
            reasons[f"{entry.stage} {entry.state}", why].append(entry.object_id)
        for text in entry.warnings:
            doubts["warning", f": {text}"].append(entry.object_id)
    for section, groups in (("reasons", reasons), ("warnings", doubts)):
        words = [f"{title}: {_names(names)}{why}" for (title, why), names in groups.items()]
        lines += ["", *words[:LINES]] if words else []
        if len(words) > LINES:
            lines.append(f"... and {len(words) - LINES} more {section} (--json has all)")
    return "\n".join(lines)


def _names(names: Sequence[str]) -> str:
    text = ", ".join(names[:NAMED])
    return text if len(names) <= NAMED else f"{text} and {len(names) - NAMED} more"
