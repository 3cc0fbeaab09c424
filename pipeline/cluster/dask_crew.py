"""A crew of Dask workers: they come and go, and so may the scheduler."""

import itertools
import secrets
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from objectfolder.errors import FormatError, InputError, SimulationError
from pipeline.cluster.environment_check import Environment
from pipeline.cluster.porter import Porter
from pipeline.cluster.scheduler_link import ENDED, JOINED, LEFT, TOLD, Event, SchedulerLink, error_of
from pipeline.cluster.worker_task import Introduction, Question, from_message, introduce, run_on_worker
from pipeline.dataset.crew import Finished, Job, Lost, Slot
from pipeline.dataset.task import Call, Outcome, failure_of
from pipeline.sandbox.isolation import ChildSettings
from pipeline.store.shipping import Shipment

PUBLISHED, COLLECTED = "published", "collected"
GONE = "the scheduler went away"
SAME = "Install on it what the driver has: the same checkout, and requirements.lock."
TICK_S = 0.5  # between looks at the connection where nothing happens
REFRESH_S = 15.0  # between looks at the list of workers, should news of one be lost
TELL_AFTER_S = 10.0  # without a worker
TOKENS = ".objectfolder"


@dataclass(frozen=True)
class Patience:
    """How long a crew waits for what may still come, in seconds.

    Parameters
    ----------
    reconnect_s
        For a scheduler that went away.
    workers_s
        For a worker while there is none; None for ever.
    pools_s
        After a worker joined or left, for others that offer what none does.
    """

    reconnect_s: float = 60.0
    workers_s: float | None = None
    pools_s: float = 60.0


@dataclass
class _Task:
    job: Job
    slot: str
    shares_folder: bool
    future: Any = None  # once its inputs are where the worker can read them
    outcome: Outcome | None = None  # while its products are being collected

    @property
    def worker(self) -> str:
        return _worker_of(self.slot)

    def release(self) -> None:
        """Tell the scheduler that nobody waits for it."""
        if self.future is not None:
            self.future.release()


class DaskCrew:
    """Workers of a Dask scheduler.

    Parameters
    ----------
    connect
        Returns a client of the scheduler, given the seconds it may take; raises OSError where there is none.
    root
        The data folder, absolute.
    settings
        How the child processes of the workers run.
    wanted
        The environment that a worker must have; None where it is this one by construction.
    memory_gb
        Memory of a host that tasks may take; None for what each worker says.
    patience
        How long to wait for what.
    """

    def __init__(
        self,
        connect: Callable[[float], Any],
        root: Path,
        settings: ChildSettings,
        wanted: Environment | None = None,
        memory_gb: float | None = None,
        patience: Patience = Patience(),
    ) -> None:
        self._root = root
        self._settings = settings
        self._patience = patience
        self._run = secrets.token_hex(8)
        self._link = SchedulerLink(connect, self._run)
        token_name = f"{TOKENS}/shared-{self._run}"
        self._token = root / token_name
        self._question = Question(root, token_name, secrets.token_hex(16), wanted, memory_gb)
        self._numbers = itertools.count()
        self._introducing: dict[str, tuple[str, Any]] = {}  # by key: worker and future
        self._workers: dict[str, Introduction] = {}  # those that get work
        self._refused: dict[str, str] = {}
        self._slots: dict[str, Slot] = {}
        self._tasks: dict[str, _Task] = {}  # by key
        self._porter: Porter | None = None
        self._changed_at = self._looked_at = time.monotonic()
        self._lamented = False

    def __enter__(self) -> "DaskCrew":
        self._token.parent.mkdir(exist_ok=True)
        self._token.write_text(self._question.token)
        try:
            self._open(self._patience.reconnect_s)
        except OSError as error:
            self._token.unlink()
            finding = f"no scheduler answers ({error})"
            raise SimulationError("cluster", finding, "Start it, or correct its address.") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._porter is not None:
            self._porter.close()
        for task in self._tasks.values():
            task.release()
        self._link.close()
        self._token.unlink(missing_ok=True)

    @property
    def client(self) -> Any:
        """The client of the scheduler; another one after the scheduler went away and returned.

        Raises
        ------
        SimulationError
            The scheduler is not there now.
        """
        if not self._link.is_up():
            raise SimulationError("cluster", GONE)
        return self._link.client

    def slots(self) -> Mapping[str, Slot]:
        """Return the slots of the workers that may work."""
        return dict(self._slots)

    def memory_bytes(self) -> Mapping[str, int]:
        """Return the memory that tasks may take on each host, as its workers state it."""
        found: dict[str, int] = {}
        for worker in self._workers.values():
            found[worker.host] = min(worker.memory_bytes, found.get(worker.host, worker.memory_bytes))
        return found

    def may_still_offer(self, needs: frozenset[str]) -> bool:
        """Return whether a slot that offers `needs` is there or may still join."""
        if any(needs <= slot.offers for slot in self._slots.values()):
            return True
        return bool(self._introducing) or self._waited() < self._patience.pools_s

    def start(self, job: Job, slot: str) -> None:
        """Send a job to the worker of a slot, its inputs first where it does not share the folder."""
        key = self._key(job.key)
        shares = self._workers[_worker_of(slot)].shares_folder
        self._tasks[key] = _Task(job, slot, shares)
        if shares:
            self._send(key, job.call)
        else:
            assert self._porter is not None
            self._porter.publish(key, job)

    def wait(self) -> Sequence[Finished | Lost]:
        """Wait until jobs end, or slots come or go, or patience with those who may come runs out.

        Raises
        ------
        SimulationError
            The scheduler is gone for good, or no worker that may work has come.
        """
        while True:
            before = self._slots
            found = [result for event in self._link.events(TICK_S) for result in self._handle(event)]
            if not self._link.is_up():
                return found + self._reconnect()
            if found or before != self._slots:
                return found
            self._look()
            if not self._slots:
                self._lament()
            elif not self._tasks and self._waited() >= self._patience.pools_s:
                return []

    def _handle(self, event: Event) -> Sequence[Finished | Lost]:
        if event.kind == JOINED:
            self._introduce(event.subject)
        elif event.kind == LEFT:
            return self._leave(event.subject)
        elif event.kind == TOLD:
            return self._told(event.subject)
        elif event.kind == ENDED:
            return self._ended(event.subject)
        elif event.kind == PUBLISHED:
            return self._published(*event.subject)
        elif event.kind == COLLECTED:
            return self._collected(*event.subject)
        return ()

    def _introduce(self, worker: str) -> None:
        """Ask a worker who it is, before it gets work."""
        asked = {address for address, _ in self._introducing.values()}
        if worker in self._workers or worker in self._refused or worker in asked:
            return
        key = self._key("introduction")
        self._introducing[key] = (worker, self._link.submit(worker, introduce, key, self._question))

    def _leave(self, worker: str) -> list[Lost]:
        """Forget a worker; what it ran is lost."""
        self._changed_at = time.monotonic()
        for key in [key for key, (address, _) in self._introducing.items() if address == worker]:
            self._introducing.pop(key)[1].release()
        self._workers.pop(worker, None)
        self._refused.pop(worker, None)
        self._slots = {name: slot for name, slot in self._slots.items() if _worker_of(name) != worker}
        # A job whose products are being collected needs its worker no more.
        keys = [key for key, task in self._tasks.items() if task.worker == worker and task.outcome is None]
        return [self._lose(key, f"worker {worker} went away") for key in keys]

    def _told(self, message: Mapping[str, Any]) -> Sequence[Finished | Lost]:
        """Take what a worker says of itself or of a job."""
        key = message["key"]
        if key in self._introducing:
            worker, future = self._introducing.pop(key)
            future.release()
            self._admit(worker, Introduction(**message["introduction"]))
        elif key in self._tasks and "lost" in message:
            return [self._lose(key, message["lost"], counts=True)]
        elif key in self._tasks:
            task, outcome = self._tasks[key], from_message(message["outcome"])
            if task.shares_folder or outcome.failure is not None:
                return [self._finish(key, outcome)]
            task.outcome = outcome
            task.release()
            assert self._porter is not None
            self._porter.collect(key, task.job)
        return ()

    def _ended(self, key: str) -> Sequence[Finished | Lost]:
        """Take the end of a task of which nothing was told: it failed around the job, not in it."""
        if key in self._introducing:
            worker, future = self._introducing.pop(key)
            self._refuse(worker, f"it cannot run this code ({error_of(future)}). {SAME}")
        elif key in self._tasks and self._tasks[key].outcome is None:
            future = self._tasks[key].future
            if future.status == "cancelled":
                return ()  # by the end of the connection, which is looked at next
            error = error_of(future)
            if future.status == "error" and type(error).__name__ != "KilledWorker":
                return [self._fail(key, error)]
            return [self._lose(key, f"its worker went away ({error})")]
        return ()

    def _published(self, key: str, result: Shipment | Exception) -> Sequence[Finished | Lost]:
        if key not in self._tasks:
            return ()  # lost meanwhile
        if isinstance(result, Exception):
            return [self._fail(key, result)]
        self._send(key, result)
        return ()

    def _collected(self, key: str, problem: Exception | None) -> Sequence[Finished | Lost]:
        outcome = self._tasks[key].outcome
        assert outcome is not None
        if problem is None:
            return [self._finish(key, outcome)]
        if isinstance(problem, FormatError):
            return [self._lose(key, f"its product was damaged on its way ({problem})")]
        return [self._fail(key, problem)]

    def _send(self, key: str, call: Call | Shipment) -> None:
        task = self._tasks[key]
        root = self._root if task.shares_folder else None
        expected_bytes = task.job.memory_bytes
        task.future = self._link.submit(
            task.worker, run_on_worker, key, call, self._settings, root, expected_bytes
        )

    def _finish(self, key: str, outcome: Outcome) -> Finished:
        task = self._tasks.pop(key)
        task.release()
        return Finished(task.job, task.slot, outcome)

    def _fail(self, key: str, error: BaseException) -> Finished:
        object_id = self._tasks[key].job.call.request.object_id
        return self._finish(key, Outcome(object_id, failure_of(object_id, error)))

    def _lose(self, key: str, reason: str, counts: bool = False) -> Lost:
        task = self._tasks.pop(key)
        task.release()
        return Lost(task.job, task.slot, reason, counts)

    def _admit(self, worker: str, answer: Introduction) -> None:
        if answer.differing:
            self._refuse(worker, f"{', '.join(answer.differing)}. {SAME}")
            return
        if not answer.shares_folder and self._porter is None:
            try:
                self._porter = Porter(
                    self._root,
                    lambda *subject: self._link.tell(Event(PUBLISHED, subject)),
                    lambda *subject: self._link.tell(Event(COLLECTED, subject)),
                )
            except InputError as error:
                self._refuse(worker, f"it does not see the data folder {self._root}. {error.remedy}")
                return
        self._changed_at = time.monotonic()
        self._workers[worker] = answer
        names = [f"{worker}#{index}" if index else worker for index in range(answer.threads)]
        own = {name: Slot(name, answer.host, frozenset(answer.offers)) for name in names}
        self._slots = {**self._slots, **own}

    def _refuse(self, worker: str, reason: str) -> None:
        self._refused[worker] = reason
        self._changed_at = time.monotonic()
        print(f"worker {worker} gets no work: {reason}", file=sys.stderr)

    def _lament(self) -> None:
        """Say that no worker is there; give up where none can be expected any more."""
        waited = 0.0 if self._introducing else self._waited()
        if self._refused and waited >= self._patience.pools_s:
            reasons = "; ".join(sorted(set(self._refused.values())))
            raise SimulationError("cluster", "no worker may work", reasons)
        if self._patience.workers_s is not None and waited >= self._patience.workers_s:
            remedy = "Look at its log, or raise workers_within_s of the place."
            raise SimulationError("cluster", f"no worker for {waited:.0f} s", remedy)
        if waited >= TELL_AFTER_S and not self._lamented:
            self._lamented = True
            print(f"waiting for workers of {self._link.address}", file=sys.stderr)

    def _waited(self) -> float:
        return time.monotonic() - self._changed_at

    def _look(self) -> None:
        """Compare with the scheduler's own list of workers now and then."""
        if time.monotonic() - self._looked_at >= REFRESH_S:
            self._looked_at = time.monotonic()
            for worker in self._link.workers():
                self._introduce(worker)

    def _open(self, seconds: float) -> None:
        self._link.open(seconds)
        self._changed_at = self._looked_at = time.monotonic()
        self._lamented = False
        for worker in self._link.workers():
            self._introduce(worker)

    def _reconnect(self) -> list[Finished | Lost]:
        """Wait for the scheduler to return at its address; what ran is lost."""
        running = [key for key, task in self._tasks.items() if task.outcome is None]
        lost: list[Finished | Lost] = [self._lose(key, GONE) for key in running]
        self._link.close()
        self._introducing.clear()
        self._workers.clear()
        self._refused.clear()
        self._slots = {}
        print(f"{GONE}; waiting {self._patience.reconnect_s:g} s for its return", file=sys.stderr)
        deadline = time.monotonic() + self._patience.reconnect_s
        while (left := deadline - time.monotonic()) > 0:
            try:
                self._open(left)
                return lost
            except OSError:
                time.sleep(min(TICK_S, left))
        raise SimulationError("cluster", GONE, "Run again: nothing finished is lost.")

    def _key(self, name: str) -> str:
        """Return a key that neither another try nor another driver of this scheduler uses."""
        return f"{name}-{self._run}-{next(self._numbers)}"


def _worker_of(slot: str) -> str:
    return slot.partition("#")[0]
