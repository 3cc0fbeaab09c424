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
    refused: dict[str, str] = {}
    listed = frozenset(rows or ())
    if rows is None:
        require_whole(root)
        records = read_table(root, parameters.objects)
        listed = records.listed
        records = records.selected(read_selection(root))
        rows = records.rows
        refused = {failure.object_id: failure.error for failure in records.refused}
    verified = Verified(root, momentary=True)
    failures = {(failure.object, failure.stage): failure for failure in read_failures(root)}
    found = [Status(object_id, stages[0].name, FAILED, (error,)) for object_id, error in refused.items()]
    for object_id, row in rows.items():
        behind: set[str] = set()  # stages of this object that are not current
        for stage in stages:
            one = _of(stage, root, parameters, object_id, row, verified, behind, failures)
            if one.state != CURRENT:
                behind.add(stage.name)
            found.append(one)
    for stage in stages:
        present = {object_id for kind in stage.products for object_id in kind.object_ids(root)}
        found += [Status(object_id, stage.name, UNLISTED) for object_id in sorted(present - listed)]
    if owner(root) is None:
        verified.save()
    return found


def _of(
    stage: Stage,
    root: Path,
    parameters: Parameters,
    object_id: str,
    row: Row,
    verified: Verified,
    behind: set[str],
    failures: Mapping[tuple[str, str], FailedObject],
) -> Status:
    awaited = tuple(f"waits for {name}" for name in sorted(stage.follows & behind))
    try:
        prepared = stage.prepare(root, parameters, object_id, row, verified)
    except InputError as error:
        if awaited:
            return Status(object_id, stage.name, WAITING, awaited)
        return Status(object_id, stage.name, FAILED, (f"{error.where}: {error.finding}",))
    wanted = fingerprint(prepared.parts)
    say = partial(Status, object_id, stage.name, wanted=wanted)
    targets = stage.targets(root, object_id)
    kept: list[str] = []
    for path in targets:
        try:
            kept.append(verified.attributes(path, (FINGERPRINT,))[FINGERPRINT])
        except FileNotFoundError:
            if awaited:
                return Status(object_id, stage.name, WAITING, awaited)
            failure = failures.get((object_id, stage.name))
            if failure and failure.fingerprint == wanted:
                return say(FAILED, (failure.error,))
            return say(MISSING)
        except FormatError as error:
            return say(STALE, (f"unreadable: {error.finding}",))
    if all(one == wanted for one in kept):
        warnings = _warnings(stage, targets[0], verified)
        return say(WAITING if awaited else CURRENT, awaited, warnings=warnings)
    changed = next(path for path, one in zip(targets, kept, strict=True) if one != wanted)
    found = _differences(changed, prepared.parts)
    return say(STALE, tuple(map(str, found)), found)


def _warnings(stage: Stage, path: Path, verified: Verified) -> tuple[str, ...]:
    """Attributes of a cleaned mesh and of modes that are shown; other products repeat them or have none."""
    if OBJECTS not in stage.products and MODES not in stage.products:
        return ()
    try:
        said = verified.attributes(path, ("warnings",))["warnings"]
    except FormatError:
        return ()
    return tuple(text for text in said if isinstance(text, str)) if isinstance(said, list) else ()


def _differences(path: Path, parts: Mapping[str, Any]) -> tuple[Reason, ...]:
    try:
        old = read_description(path).get("provenance", {})
    except (FileNotFoundError, FormatError):
        old = {}
    old = json.loads(old) if isinstance(old, str) else old
    return tuple(differences(old, json.loads(canonical_json(parts))))


def table(statuses: Sequence[Status]) -> str:
    """Return counts of every stage, and reasons, objects that share one together."""
    stages = list(dict.fromkeys(one.stage for one in statuses))
    shown = [state for state in STATES if any(one.state == state for one in statuses)] or [CURRENT]
    counts = Counter((one.stage, one.state) for one in statuses)
    rows = [(stage, *(str(counts[stage, state] or "") for state in shown)) for stage in stages]
    lines = columns([("stage", *shown), *rows])
    reasons: dict[tuple[str, str], list[str]] = defaultdict(list)
    doubts: dict[tuple[str, str], list[str]] = defaultdict(list)
    for one in statuses:
        if one.state not in (CURRENT, WAITING):
            why = f" ({'; '.join(one.reasons)})" if one.reasons else ""
            reasons[f"{one.stage} {one.state}", why].append(one.object_id)
        for text in one.warnings:
            doubts["warning", f": {text}"].append(one.object_id)
    for what, groups in (("reasons", reasons), ("warnings", doubts)):
        said = [f"{title}: {_names(names)}{why}" for (title, why), names in groups.items()]
        lines += ["", *said[:LINES]] if said else []
        if len(said) > LINES:
            lines.append(f"... and {len(said) - LINES} more {what} (--json has all)")
    return "\n".join(lines)


def _names(names: Sequence[str]) -> str:
    text = ", ".join(names[:NAMED])
    return text if len(names) <= NAMED else f"{text} and {len(names) - NAMED} more"
