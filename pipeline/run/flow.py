"""The state of each object in each stage, and which tasks can run as their inputs are made."""

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from objectfolder.errors import InputError
from objectfolder.products.provenance import fingerprint
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.job import Finished, Job
from pipeline.dataset.parameters import Parameters
from pipeline.dataset.products import STATE
from pipeline.dataset.stage import Prepared, Row, Stage
from pipeline.dataset.task import Call, Failure, Outcome, failure_of
from pipeline.dataset.tolerances import as_json
from pipeline.dataset.verified import Verified
from pipeline.store.product_cache import ProductCache

if TYPE_CHECKING:
    from pipeline.run.estimates import Estimates

OnSettled = Callable[[str, str, str, float], None]
LOOKUPS = 16  # of products in DVC's cache or a shared store at once
KEPT, RESTORED, COMPUTED, FAILED = "kept", "restored", "computed", "failed"


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
        verified: Verified,
        on_settled: OnSettled = lambda stage, object_id, outcome, wall_s: None,
    ) -> None:
        self._stages = {stage.name: stage for stage in stages}
        self._root = root
        self._parameters = parameters
        self._rows = rows
        self._verified = verified
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
        for object_id in self._rows:
            self._advance(object_id)  # settles what is there, and delays what is not
        delayed, self._delayed = self._delayed or {}, None
        with ThreadPoolExecutor(LOOKUPS, thread_name_prefix="look-up") as pool:
            return [job for jobs in pool.map(self._advance, delayed) for job in jobs]

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
            before = (self.outcomes[other] for other in stage.follows if other in self._stages)
            if all(object_id in outcomes for outcomes in before):
                job = self._plan(stage, object_id)
                if job is not None:
                    self._running.add((name, object_id))
                    jobs.append(job)
        return jobs

    def _plan(self, stage: Stage, object_id: str) -> Job | None:
        """Settle a stage of an object, or return what has to be computed."""
        try:
            prepared = stage.prepare(
                self._root, self._parameters, object_id, self._rows[object_id], self._verified
            )
        except InputError as error:
            self._fail(stage, object_id, failure_of(object_id, error))
            return None
        wanted = self._fingerprints[stage.name][object_id] = fingerprint(prepared.parts)
        targets = stage.targets(self._root, object_id)
        if all(self._verified.holds(path, wanted) for path in targets):
            self._settle(stage.name, object_id, KEPT)
            return None
        if self._delayed is not None:
            self._delayed[object_id] = None
            return None
        if self._cache.restore(wanted, targets):
            for path in targets:
                self._verified.add(path, wanted)
            self._settle(stage.name, object_id, RESTORED)
        else:
            provenance = {
                **prepared.parts,
                "fingerprints": {**stage.lineage(prepared.parts), stage.name: wanted},
                "tolerances": as_json(stage.tolerances),
            }
            state = self._root / STATE
            call = Call(stage.name, stage.task, prepared.request, targets, wanted, provenance, state)
            with self._lock:
                return self._job(stage, call, prepared)
        return None

    def _job(self, stage: Stage, call: Call, prepared: Prepared) -> Job:
        object_id = call.request.object_id
        own = self._estimates.of(stage.name, object_id)
        chain_s = self._chain_seconds(stage, object_id)
        return Job(call, own.cpu_s, chain_s, own.memory_bytes, stage.needs, prepared.inputs)

    def _chain_seconds(self, stage: Stage, object_id: str) -> float:
        """Return the expected seconds of the longest chain of tasks from `stage` on."""
        after = [other for other in self._stages.values() if stage.name in other.follows]
        behind_s = max((self._chain_seconds(other, object_id) for other in after), default=0.0)
        return self._estimates.of(stage.name, object_id).cpu_s + behind_s

    def _settle(self, stage: str, object_id: str, outcome: str, cost: Outcome | None = None) -> None:
        self.outcomes[stage][object_id] = outcome
        self._on_settled(stage, object_id, outcome, cost.wall_s if cost else 0.0)

    def _fail(self, stage: Stage, object_id: str, failure: Failure, cost: Outcome | None = None) -> None:
        """Note a failure, and remove the object's earlier products.

        In a folder that cannot be written these stay: their fingerprints tell that they are not of this run.
        """
        self._settle(stage.name, object_id, FAILED, cost)
        wanted = self._fingerprints[stage.name].get(object_id, "")
        self.failures[stage.name].append(FailedObject.of(stage.name, failure, wanted))
        for path in stage.targets(self._root, object_id):
            with contextlib.suppress(OSError):
                path.unlink()
