"""Makes the products that the inputs ask for: keeps current ones and computes the others.

The result is a pure function of the inputs, whatever was there before and however often it was
interrupted: a product is kept if it carries the wanted fingerprint, taken from DVC's cache if that
has it, and computed otherwise, longest expected first; products of objects not listed, and of objects that
fail, go. Over several stages an object goes on to its next stage as soon as its own inputs are there.
"""

import contextlib
import sys
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from objectfolder.errors import InputError
from objectfolder.products.provenance import fingerprint
from pipeline.dataset.failures import FailedObject, failure_table, write_failures
from pipeline.dataset.job import Finished, Job, Runner
from pipeline.dataset.manifest import forget
from pipeline.dataset.parameters import Parameters
from pipeline.dataset.products import STATE
from pipeline.dataset.stage import Prepared, Row, Stage
from pipeline.dataset.task import Call, Failure, Outcome, failure_of
from pipeline.dataset.tolerances import as_json
from pipeline.dataset.verified import Verified, without_collector
from pipeline.run.costs import add_costs
from pipeline.run.flow_progress import FlowProgress
from pipeline.run.run_record import RunRecord
from pipeline.sandbox import scratch
from pipeline.store import shared
from pipeline.store.product_cache import ProductCache
from pipeline.store.storage import disk_error

if TYPE_CHECKING:
    from pipeline.run.estimates import Estimates

KEPT, RESTORED, COMPUTED, FAILED = "kept", "restored", "computed", "failed"
LOOKUPS = 16  # of products in DVC's cache or a shared store at once
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
        numbers = {name: len(getattr(self, name)) for name in (KEPT, RESTORED, COMPUTED)}
        return numbers | {"failed": len(self.failures)}

    def exit_code(self, allow_failures: bool) -> int:
        """Return 0 if later stages may run: no failure, or failures allowed and at least one object made."""
        products = self.kept or self.restored or self.computed
        return 0 if not self.failures or (allow_failures and products) else 1


def converge(
    stages: Sequence[Stage],
    root: Path,
    parameters: Parameters,
    rows: Mapping[str, Row],
    runner_for: RunnerFor,
    refused: Sequence[FailedObject] = (),
    rest: Collection[str] = (),
    states: Verified | None = None,
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
    rest
        Listed objects that are not asked for now: their products stay as they are.
    states
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
    removed = {stage.name: _tidy(stage, root, {*rows, *rest}) for stage in stages}
    states, progress = (
        states or Verified(root),
        FlowProgress({each_stage.name: sorted(each_stage.follows) for each_stage in stages}),
    )
    flow = Flow(stages, root, parameters, rows, states, progress.settle)
    with RunRecord(root, [stage.name for stage in stages]) as record:
        try:
            with without_collector():
                jobs = flow.begin()
            states.save_code()  # children read it, too
            if jobs:
                _run(jobs, flow, root, runner_for, record, progress)
            else:
                scratch.sweep()  # else done by who runs jobs
        finally:
            progress.close()
            _sweep(stages, root)
            states.save()
            shared.settle(root / STATE)
        before = {stages[0].name: tuple(refused)}
        summaries = [
            _summary(name, flow, removals, before.get(name, ())) for name, removals in removed.items()
        ]
        failures = [failure for summary in summaries for failure in summary.failures]
        try:
            write_failures(root, failures, stages, rest)
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
    flow: "Flow",
    root: Path,
    runner_for: RunnerFor,
    record: RunRecord,
    progress: FlowProgress,
) -> None:
    """Run jobs and those that follow from them, one after the other where a cluster would save no time."""
    outlook = list(flow.unsettled())
    for entry in outlook:
        progress.expect(*entry)
    forget(root, {(stage, object_id) for stage, object_id, _ in outlook})
    saved_s = sum(seconds for *_, seconds in outlook) - max(job.path_seconds for job in jobs)
    with runner_for(len(outlook) if saved_s > CLUSTER_S else 1) as runner:
        for job in sorted(jobs, key=lambda job: job.path_seconds, reverse=True):
            runner.submit(job)
        for end in runner.finished(progress.workers):
            stage, outcome = end.job.call.stage, end.outcome
            if outcome.failure is None and outcome.wall_s > 0:
                add_costs(root, stage, outcome)
            record.task(stage, outcome, end.worker, end.host, end.tries)
            for job in flow.done(end):
                runner.submit(job)


def _sweep(stages: Sequence[Stage], root: Path) -> None:
    """Remove half-written files, and marks of drivers that were killed."""
    for kind in (kind for stage in stages for kind in stage.products):
        kind.sweep(root)
    for mark in (root / STATE).glob("shared-*"):
        mark.unlink(missing_ok=True)  # of a driver that was killed: there is one run at a time


def _tidy(stage: Stage, root: Path, ids: Collection[str]) -> tuple[str, ...]:
    """Remove half-written files, and products of objects not listed; return the ids of those."""
    for kind in stage.products:
        (root / kind.folder).mkdir(parents=True, exist_ok=True)
    _sweep([stage], root)
    present = {object_id for kind in stage.products for object_id in kind.object_ids(root)}
    extra_ids = sorted(present - set(ids))
    for object_id in extra_ids:
        for path in stage.targets(root, object_id):
            path.unlink(missing_ok=True)
    return tuple(extra_ids)


def _summary(stage: str, flow: "Flow", removed: tuple[str, ...], refused: Sequence[FailedObject]) -> Summary:
    kept, restored, computed = (
        tuple(sorted(object_id for object_id, result in flow.outcomes[stage].items() if result == outcome))
        for outcome in (KEPT, RESTORED, COMPUTED)
    )
    failures = (*refused, *flow.failures[stage])
    return Summary(stage, kept, restored, computed, removed, failures)


class Flow:
    """The state of every object in every stage; for arguments see `converge`.

    `on_settled` is told of each object that is settled in a stage, and the wall seconds of its task, 0 if
    none ran.
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        root: Path,
        parameters: Parameters,
        rows: Mapping[str, Row],
        states: Verified,
        on_settled: Callable[[str, str, str, float], None],
    ) -> None:
        self._stages = {stage.name: stage for stage in stages}
        self._root = root
        self._parameters = parameters
        self._rows = rows
        self._verified = states
        self._on_settled = on_settled
        self._cache = ProductCache(root)
        # `KEPT`, `RESTORED`, `COMPUTED` or `FAILED` of those settled, by stage and object; and failures.
        self.outcomes: dict[str, dict[str, str]] = {name: {} for name in self._stages}
        self.failures: dict[str, list[FailedObject]] = {name: [] for name in self._stages}
        self._fingerprints: dict[str, dict[str, str]] = {name: {} for name in self._stages}
        self._running: set[tuple[str, str]] = set()
        self._lock = threading.Lock()  # of the estimates
        # At first, objects whose products must be looked up in caches and stores: many at once, afterwards.
        self._delayed: dict[str, None] | None = {}

    def begin(self) -> list[Job]:
        """Settle what needs no work, and return the jobs whose inputs are there."""
        with self._verified.moment():
            for object_id in self._rows:
                self._advance(object_id)  # settles current products, and delays the others
        pending, self._delayed = self._delayed or {}, None
        with ThreadPoolExecutor(LOOKUPS, thread_name_prefix="look-up") as pool:
            return [job for jobs in pool.map(self._advance, pending) for job in jobs]

    def done(self, finished: Finished) -> list[Job]:
        """Note how a job ended, and return the jobs whose inputs are there now."""
        call = finished.job.call
        object_id = call.request.object_id
        self._running.discard((call.stage, object_id))
        if finished.outcome.failure is None:
            for path in call.targets:
                self._verified.add(path, call.fingerprint)
            self._settle(call.stage, object_id, COMPUTED, finished.outcome)
        else:
            stage = self._stages[call.stage]
            self._fail(stage, object_id, finished.outcome.failure, finished.outcome)
        return self._advance(object_id)

    def unsettled(self) -> Iterator[tuple[str, str, float]]:
        """Yield stage, object and expected seconds of what is still to be made or looked at."""
        for name, outcomes in self.outcomes.items():
            for object_id in self._rows:
                if object_id not in outcomes:
                    yield name, object_id, self._estimates.of(name, object_id).cpu_s

    @cached_property
    def _estimates(self) -> "Estimates":
        """What tasks are expected to cost; imported and read only if there are any."""
        from pipeline.run.estimates import Estimates

        return Estimates(self._root, self._parameters)

    def _advance(self, object_id: str) -> list[Job]:
        jobs = []
        for name, stage in self._stages.items():
            if object_id in self.outcomes[name] or (name, object_id) in self._running:
                continue
            before = (self.outcomes[earlier] for earlier in stage.follows if earlier in self._stages)
            if all(object_id in outcomes for outcomes in before):
                job = self._plan(stage, object_id)
                if job is not None:
                    self._running.add((name, object_id))
                    jobs.append(job)
        return jobs

    def _plan(self, stage: Stage, object_id: str) -> Job | None:
        """Settle a stage of an object, or return what has to be computed."""
        try:
            preparation = stage.prepare(
                self._root, self._parameters, object_id, self._rows[object_id], self._verified
            )
        except InputError as error:
            self._fail(stage, object_id, failure_of(object_id, error))
            return None
        digest = self._fingerprints[stage.name][object_id] = fingerprint(preparation.parts)
        targets = stage.targets(self._root, object_id)
        if all(self._verified.holds(path, digest) for path in targets):
            self._settle(stage.name, object_id, KEPT)
            return None
        if self._delayed is not None:
            self._delayed[object_id] = None
            return None
        if self._cache.restore(digest, targets):
            for path in targets:
                self._verified.add(path, digest)
            self._settle(stage.name, object_id, RESTORED)
        else:
            provenance = {
                **preparation.parts,
                "fingerprints": {**stage.lineage(preparation.parts), stage.name: digest},
                "tolerances": as_json(stage.tolerances),
            }
            state = self._root / STATE
            call = Call(stage.name, stage.task, preparation.request, targets, digest, provenance, state)
            with self._lock:
                return self._job(stage, call, preparation)
        return None

    def _job(self, stage: Stage, call: Call, preparation: Prepared) -> Job:
        object_id = call.request.object_id
        own = self._estimates.of(stage.name, object_id)
        chain_s = self._chain_seconds(stage, object_id)
        return Job(call, own.cpu_s, chain_s, own.memory_bytes, stage.needs, preparation.inputs)

    def _chain_seconds(self, stage: Stage, object_id: str) -> float:
        """Return the expected seconds of the longest chain of tasks from `stage` on."""
        after = [later for later in self._stages.values() if stage.name in later.follows]
        behind_s = max((self._chain_seconds(later, object_id) for later in after), default=0.0)
        return self._estimates.of(stage.name, object_id).cpu_s + behind_s

    def _settle(self, stage: str, object_id: str, outcome: str, cost: Outcome | None = None) -> None:
        self.outcomes[stage][object_id] = outcome
        self._on_settled(stage, object_id, outcome, cost.wall_s if cost else 0.0)

    def _fail(self, stage: Stage, object_id: str, failure: Failure, cost: Outcome | None = None) -> None:
        """Note a failure, and remove the object's earlier products.

        In a folder that cannot be written these stay: their fingerprints tell that they are not of this run.
        """
        self._settle(stage.name, object_id, FAILED, cost)
        digest = self._fingerprints[stage.name].get(object_id, "")
        self.failures[stage.name].append(FailedObject.of(stage.name, failure, digest))
        for path in stage.targets(self._root, object_id):
            with contextlib.suppress(OSError):
                path.unlink()
