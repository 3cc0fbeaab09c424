"""Bring the products of a stage to what the inputs ask for, doing only what is left to do.

The result is a pure function of the inputs, whatever was there before and however often it was
interrupted: a product is kept if it carries the wanted fingerprint, taken from the memo if that has
it, and computed otherwise, longest expected first; products of objects not listed, and of objects that
fail, go.
"""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.provenance import fingerprint
from pipeline import memo
from pipeline.parameters import Parameters
from pipeline.progress import Progress, failure_table
from pipeline.run_log import Costs, write_run
from pipeline.stage import Row, Stage
from pipeline.task import Call, Failure, Outcome, failure_of
from pipeline.verified import Verified

RunCalls = Callable[[Sequence[Call]], Iterable[Outcome]]


@dataclass(frozen=True)
class Summary:
    """Object ids by what happened to them, and the failures."""

    kept: tuple[str, ...]
    restored: tuple[str, ...]  # from the memo
    computed: tuple[str, ...]
    removed: tuple[str, ...]
    failures: tuple[Failure, ...]

    def exit_code(self, allow_failures: bool) -> int:
        """Return 0 if the stage stands: no failure, or failures allowed and at least one object made."""
        made = self.kept or self.restored or self.computed
        return 0 if not self.failures or (allow_failures and made) else 1


@dataclass
class _Plan:
    fingerprints: dict[str, str]
    kept: list[str]
    restored: list[str]
    calls: dict[str, Call]
    failures: list[Failure]


def converge(
    stage: Stage,
    root: Path,
    parameters: Parameters,
    rows: Mapping[str, Row],
    run: RunCalls,
    refused: Sequence[Failure] = (),
) -> Summary:
    """Make, keep and remove products until those of `stage` are what the inputs ask for.

    Parameters
    ----------
    stage
        What to converge.
    root
        Root of the data set, absolute.
    parameters
        Of the whole run; the stage picks what it reads.
    rows
        The listed objects.
    run
        Runs calls in the given order and yields their outcomes (see `pipeline.cluster.run_calls`).
    refused
        Objects that were refused before this stage; they count as failures.

    Returns
    -------
    Summary
        What happened; also logged under ``runs/``.
    """
    for kind in stage.products:
        (root / kind.folder).mkdir(parents=True, exist_ok=True)
        kind.sweep(root)
    removed = _remove_unlisted(stage, root, rows)
    verified = Verified(root)
    plan = _plan(stage, root, parameters, rows, verified)
    for failure in plan.failures:
        _remove(stage, root, failure.object_id)
    plan.failures[:0] = refused  # their ids may be no file names; as unlisted ones they are gone already
    costs = Costs(root, stage.name)
    sizes = {
        object_id: sum(path.stat().st_size for path in call.request.inputs.values())
        for object_id, call in plan.calls.items()
    }
    expected = costs.expected(sizes)
    progress = Progress(stage.name, len(plan.kept) + len(plan.restored), len(plan.failures), expected)
    computed = []
    try:
        for outcome in run(sorted(plan.calls.values(), key=lambda call: -expected[call.request.object_id])):
            if outcome.failure is None:
                computed.append(outcome.object_id)
                costs.add(outcome)
                for path in stage.targets(root, outcome.object_id):
                    verified.add(path)
            else:
                plan.failures.append(outcome.failure)
                _remove(stage, root, outcome.object_id)
            progress.add(outcome)
    finally:
        verified.save()
        memo.prune(root)
    progress.close()
    summary = Summary(
        tuple(plan.kept), tuple(plan.restored), tuple(sorted(computed)), tuple(removed), tuple(plan.failures)
    )
    _log(stage, root, plan, summary, costs)
    if summary.failures:
        print(failure_table(summary.failures), file=sys.stderr)
    return summary


def _plan(
    stage: Stage, root: Path, parameters: Parameters, rows: Mapping[str, Row], verified: Verified
) -> _Plan:
    plan = _Plan({}, [], [], {}, [])
    for object_id, row in rows.items():
        try:
            request, parts = stage.prepare(root, parameters, object_id, row)
        except InputError as error:
            plan.failures.append(failure_of(object_id, error))
            continue
        wanted = plan.fingerprints[object_id] = fingerprint(parts)
        targets = stage.targets(root, object_id)
        folder = memo.memo_folder(root, wanted)
        if all(verified.holds(path, wanted) for path in targets):
            plan.kept.append(object_id)
        elif memo.restore(folder, wanted, targets):
            plan.restored.append(object_id)
            for path in targets:
                verified.add(path)
        else:
            provenance = {**parts, "fingerprints": {**stage.lineage(parts), stage.name: wanted}}
            plan.calls[object_id] = Call(stage.name, stage.task, request, targets, wanted, provenance, folder)
    return plan


def _remove_unlisted(stage: Stage, root: Path, rows: Mapping[str, Row]) -> list[str]:
    present = {object_id for kind in stage.products for object_id in kind.object_ids(root)}
    unlisted = sorted(present - set(rows))
    for object_id in unlisted:
        _remove(stage, root, object_id)
    return unlisted


def _remove(stage: Stage, root: Path, object_id: str) -> None:
    for path in stage.targets(root, object_id):
        path.unlink(missing_ok=True)


def _log(stage: Stage, root: Path, plan: _Plan, summary: Summary, costs: Costs) -> None:
    outcomes = {
        **dict.fromkeys(summary.kept, "kept"),
        **dict.fromkeys(summary.restored, "restored"),
        **dict.fromkeys(summary.computed, "computed"),
        **{failure.object_id: "failed" for failure in summary.failures},
    }
    lines = []
    for object_id, outcome in sorted(outcomes.items()):
        cost = costs.of(plan.fingerprints.get(object_id, ""))
        known = cost if outcome != "failed" else None
        lines.append(
            {
                "object_id": object_id,
                "stage": stage.name,
                "fingerprint": plan.fingerprints.get(object_id),
                "outcome": outcome,
                "wall_s": known.wall_s if known else None,
                "cpu_s": known.cpu_s if known else None,
                "peak_memory_mb": known.peak_memory_mb if known else None,
            }
        )
    write_run(root, stage.name, lines, summary.failures)
