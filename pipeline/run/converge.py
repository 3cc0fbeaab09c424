"""Makes the products that the inputs ask for: keeps current ones and computes the others.

The result is a pure function of the inputs, whatever was there before and however often it was
interrupted: a product is kept if it carries the wanted fingerprint, taken from DVC's cache if that
has it, and computed otherwise, longest expected first; products of objects not listed, and of objects that
fail, go. Over several stages an object goes on to its next stage as soon as its own inputs are there.
"""

import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from pipeline.dataset.failures import FailedObject, failure_table, write_failures
from pipeline.dataset.job import Job, Runner
from pipeline.dataset.manifest import forget
from pipeline.dataset.parameters import Parameters
from pipeline.dataset.products import STATE
from pipeline.dataset.stage import Row, Stage
from pipeline.dataset.verified import Verified, without_collector
from pipeline.run.costs import add_costs
from pipeline.run.flow import COMPUTED, KEPT, RESTORED, Flow
from pipeline.run.flow_progress import FlowProgress
from pipeline.run.run_record import RunRecord
from pipeline.sandbox import scratch
from pipeline.store import shared
from pipeline.store.storage import disk_error

CLUSTER_S = 5.0  # wall seconds that a cluster of this machine takes to start, and its processes to import

# Takes the number of tasks to run side by side at most, and returns the runner; called only where there
# are tasks.
RunnerFor = Callable[[int], AbstractContextManager[Runner]]


@dataclass(frozen=True)
class Summary:
    """Object ids of a stage by what happened to them, and the failures."""

    stage: str
    kept: tuple[str, ...]
    restored: tuple[str, ...]  # from DVC's cache, or a shared store
    computed: tuple[str, ...]
    removed: tuple[str, ...]
    failures: tuple[FailedObject, ...]

    @property
    def counts(self) -> dict[str, int]:
        """Number of objects by what happened to them."""
        made = {name: len(getattr(self, name)) for name in (KEPT, RESTORED, COMPUTED)}
        return made | {"failed": len(self.failures)}

    def exit_code(self, allow_failures: bool) -> int:
        """Return 0 if later stages may run: no failure, or failures allowed and at least one object made."""
        made = self.kept or self.restored or self.computed
        return 0 if not self.failures or (allow_failures and made) else 1


def converge(
    stages: Sequence[Stage],
    root: Path,
    parameters: Parameters,
    rows: Mapping[str, Row],
    runner_for: RunnerFor,
    refused: Sequence[FailedObject] = (),
    others: Collection[str] = (),
    verified: Verified | None = None,
) -> list[Summary]:
    """Make, keep and remove products until those of `stages` are what the inputs ask for.

    Parameters
    ----------
    stages
        What to converge, each after those whose products it reads.
    root
        Root of the data set, absolute.
    parameters
        Of the whole run; each stage picks what it reads.
    rows
        The objects to make.
    runner_for
        Who runs the tasks (see `pipeline.cluster.cluster.runner`).
    refused
        Objects that were refused before the first stage; they count as its failures.
    others
        Listed objects that are not asked for now: their products stay as they are.
    verified
        What is known of products and sources in `root`; read from there if it is not given.

    Returns
    -------
    list of Summary
        What happened, a stage each; also logged under ``runs/`` and in ``data/failures.json``.

    Raises
    ------
    SimulationError
        Nobody can run tasks any more, or the disk is full. What is finished stays finished.
    """
    removed = {stage.name: _tidy(stage, root, {*rows, *others}) for stage in stages}
    verified, progress = (
        verified or Verified(root),
        FlowProgress({one.name: sorted(one.follows) for one in stages}),
    )
    flow = Flow(stages, root, parameters, rows, verified, progress.settle)
    with RunRecord(root, [stage.name for stage in stages]) as record:
        try:
            with without_collector():
                jobs = flow.begin()
            verified.save_code()  # children read it, too
            if jobs:
                _run(jobs, flow, root, runner_for, record, progress)
            else:
                scratch.sweep()  # else done by who runs jobs
        finally:
            progress.close()
            _sweep(stages, root)
            verified.save()
            shared.settle(root / STATE)
        before = {stages[0].name: tuple(refused)}
        summaries = [_summary(name, flow, gone, before.get(name, ())) for name, gone in removed.items()]
        failures = [failure for summary in summaries for failure in summary.failures]
        try:
            write_failures(root, failures, stages, others)
        except OSError as error:
            raise disk_error(error, root / "data") from error
        for summary in summaries:
            record.stage(summary.stage, summary.removed, **summary.counts)
    _print_first(failures)
    return summaries


def _print_first(failures: Sequence[FailedObject]) -> None:
    """Print why each object failed in the first stage where it did."""
    if failures:
        first = {failure.object: failure for failure in reversed(failures)}
        print(failure_table(list(reversed(first.values()))), file=sys.stderr)


def _run(
    jobs: Sequence[Job],
    flow: Flow,
    root: Path,
    runner_for: RunnerFor,
    record: RunRecord,
    progress: FlowProgress,
) -> None:
    """Run jobs and those that follow from them, one after the other where a cluster would save no time."""
    left = list(flow.unsettled())
    for expected in left:
        progress.expect(*expected)
    forget(root, {(stage, object_id) for stage, object_id, _ in left})
    saved_s = sum(seconds for *_, seconds in left) - max(job.path_seconds for job in jobs)
    with runner_for(len(left) if saved_s > CLUSTER_S else 1) as runner:
        for job in sorted(jobs, key=lambda job: job.path_seconds, reverse=True):
            runner.submit(job)
        for ended in runner.finished(progress.workers):
            stage, outcome = ended.job.call.stage, ended.outcome
            if outcome.failure is None and outcome.wall_s > 0:
                add_costs(root, stage, outcome)
            record.task(stage, outcome, ended.worker, ended.host, ended.tries)
            for job in flow.done(ended):
                runner.submit(job)


def _sweep(stages: Sequence[Stage], root: Path) -> None:
    """Remove half-written files, and marks of drivers that were killed."""
    for kind in (kind for stage in stages for kind in stage.products):
        kind.sweep(root)
    for mark in (root / STATE).glob("shared-*"):
        mark.unlink(missing_ok=True)  # of a driver that was killed: there is one run at a time


def _tidy(stage: Stage, root: Path, listed: Collection[str]) -> tuple[str, ...]:
    """Remove half-written files, and products of objects not listed; return the ids of those."""
    for kind in stage.products:
        (root / kind.folder).mkdir(parents=True, exist_ok=True)
    _sweep([stage], root)
    present = {object_id for kind in stage.products for object_id in kind.object_ids(root)}
    unlisted = sorted(present - set(listed))
    for object_id in unlisted:
        for path in stage.targets(root, object_id):
            path.unlink(missing_ok=True)
    return tuple(unlisted)


def _summary(stage: str, flow: Flow, removed: tuple[str, ...], refused: Sequence[FailedObject]) -> Summary:
    kept, restored, computed = (
        tuple(sorted(object_id for object_id, other in flow.outcomes[stage].items() if other == outcome))
        for outcome in (KEPT, RESTORED, COMPUTED)
    )
    failures = (*refused, *flow.failures[stage])
    return Summary(stage, kept, restored, computed, removed, failures)
