"""A crew of Dask workers: they come and go, and so may the scheduler."""

import itertools
import queue
import secrets
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from objectfolder.errors import SimulationError
from pipeline.crew import Finished, Job, Lost, Slot
from pipeline.environment_check import Environment
from pipeline.isolation import ChildSettings
from pipeline.task import Outcome, failure_of
from pipeline.worker_task import TOPIC, Introduction, Question, from_message, introduce, run_on_worker

GONE = "the scheduler went away"
TICK_S = 0.5  # between looks at the connection where nothing happens
REFRESH_S = 15.0  # between looks at the list of workers, should news of one be lost
TELL_AFTER_S = 10.0  # without a worker
TOKENS = ".objectfolder"
SAME = "Install on it what the driver has: the same checkout, and requirements.lock."
CLOSE_S = 10.0
JOINED, LEFT, TOLD, ENDED = "joined", "left", "told", "ended"


@dataclass(frozen=True)
class Patience:
    """How long a crew waits for what may still come, in seconds.

    Parameters
    ----------
    reconnect_s
        For a scheduler that went away.
    workers_s
        For a first worker; None for ever.
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
    future: Any


@dataclass(frozen=True)
class _Event:
    kind: str
    subject: Any
    connection: int


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
        self._connect = connect
        self._root = root
        self._settings = settings
        self._patience = patience
        self._run = secrets.token_hex(8)
        token_name = f"{TOKENS}/shared-{self._run}"
        self._token = root / token_name
        self._question = Question(root, token_name, secrets.token_hex(16), wanted, memory_gb)
        self._events: queue.SimpleQueue[_Event] = queue.SimpleQueue()
        self._numbers = itertools.count()
        self._connection = 0
        self._client: Any = None
        self._stream: Any = None
        self._introducing: dict[str, tuple[str, Any]] = {}  # by key: worker and future
        self._workers: dict[str, Introduction] = {}  # those that get work
        self._refused: dict[str, str] = {}
        self._slots: dict[str, Slot] = {}
        self._tasks: dict[str, _Task] = {}  # by key
        self._changed_at = self._looked_at = time.monotonic()
        self._lamented = False

    def __enter__(self) -> "DaskCrew":
        self._token.parent.mkdir(exist_ok=True)
        self._token.write_text(self._question.token)
        self._open(self._patience.reconnect_s)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()
        self._token.unlink(missing_ok=True)

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
        return bool(self._introducing) or time.monotonic() - self._changed_at < self._patience.pools_s

    def start(self, job: Job, slot: str) -> None:
        """Send a job to the worker of a slot."""
        worker = slot.partition("#")[0]
        key = self._key(job.key)
        future = self._submit(run_on_worker, key, worker, job.call, self._settings, self._root)
        self._tasks[key] = _Task(job, slot, future)

    def wait(self) -> Sequence[Finished | Lost]:
        """Wait until jobs end, or slots come or go, or patience with those who may come runs out.

        Raises
        ------
        SimulationError
            The scheduler is gone for good, or no worker that may work has come.
        """
        while True:
            before = dict(self._slots)
            found = [result for event in self._pending() for result in self._handle(event)]
            if self._client.status != "running" or self._client.scheduler_comm is not self._stream:
                return found + self._reconnect()
            if found or before != self._slots:
                return found
            self._look()
            if not self._slots:
                self._lament()
            elif not self._tasks and self._waited() >= self._patience.pools_s:
                return []

    def _pending(self) -> list[_Event]:
        """Return what happened, after waiting a moment for a first event."""
        found = []
        try:
            found.append(self._events.get(timeout=TICK_S))
            while True:
                found.append(self._events.get_nowait())
        except queue.Empty:
            return [event for event in found if event.connection == self._connection]

    def _handle(self, event: _Event) -> Sequence[Finished | Lost]:
        if event.kind == JOINED:
            self._introduce(event.subject)
        elif event.kind == LEFT:
            return self._leave(event.subject["worker"], bool(event.subject.get("expected")))
        elif event.kind == TOLD:
            return self._told(event.subject)
        elif event.kind == ENDED:
            return self._ended(event.subject)
        return ()

    def _introduce(self, worker: str) -> None:
        """Ask a worker who it is, before it gets work."""
        known = {address for address, _ in self._introducing.values()}
        if worker in self._workers or worker in self._refused or worker in known:
            return
        key = self._key("introduction")
        self._introducing[key] = (worker, self._submit(introduce, key, worker, self._question))

    def _leave(self, worker: str, expected: bool) -> list[Lost]:
        """Forget a worker; what it ran is lost."""
        self._changed_at = time.monotonic()
        for key in [key for key, (address, _) in self._introducing.items() if address == worker]:
            self._introducing.pop(key)[1].release()
        self._workers.pop(worker, None)
        self._refused.pop(worker, None)
        gone = {name for name in self._slots if name.partition("#")[0] == worker}
        self._slots = {name: slot for name, slot in self._slots.items() if name not in gone}
        keys = [key for key, task in self._tasks.items() if task.slot.partition("#")[0] == worker]
        return [self._lose(key, f"worker {worker} went away", not expected) for key in keys]

    def _lose(self, key: str, reason: str, counts: bool) -> Lost:
        task = self._tasks.pop(key)
        task.future.release()
        return Lost(task.job, task.slot, reason, counts)

    def _told(self, message: Mapping[str, Any]) -> list[Finished | Lost]:
        """Take what a worker says of itself or of a job."""
        key = message["key"]
        if key in self._introducing:
            worker, future = self._introducing.pop(key)
            future.release()
            answer = Introduction(**message["introduction"])
            self._admit(worker, answer, refusal(answer))
        elif key in self._tasks and "lost" in message:
            return [self._lose(key, message["lost"], True)]
        elif key in self._tasks:
            task = self._tasks.pop(key)
            task.future.release()
            return [Finished(task.job, task.slot, from_message(message["outcome"]))]
        return []

    def _ended(self, key: str) -> list[Finished | Lost]:
        """Take the end of a task of which nothing was told: it failed around the job, not in it."""
        if key in self._introducing:
            worker, future = self._introducing.pop(key)
            self._refuse(worker, f"it cannot run this code ({_error(future)})")
        elif key in self._tasks:
            future = self._tasks[key].future
            error = _error(future)
            if future.status == "error" and type(error).__name__ != "KilledWorker":
                task = self._tasks.pop(key)
                object_id = task.job.call.request.object_id
                return [Finished(task.job, task.slot, Outcome(object_id, failure_of(object_id, error)))]
            return [self._lose(key, f"its worker went away ({error})", True)]
        return []

    def _admit(self, worker: str, answer: Introduction, refused: str) -> None:
        if refused:
            self._refuse(worker, refused)
            return
        self._changed_at = time.monotonic()
        self._workers[worker] = answer
        for index in range(answer.threads):
            name = f"{worker}#{index}" if index else worker
            self._slots[name] = Slot(name, answer.host, frozenset(answer.offers))

    def _refuse(self, worker: str, reason: str) -> None:
        self._refused[worker] = reason
        self._changed_at = time.monotonic()
        print(f"worker {worker} gets no work: {reason}", file=sys.stderr)

    def _lament(self) -> None:
        """Say that no worker is there; give up where nobody can be expected any more."""
        waited = self._waited()
        if self._refused and not self._introducing and waited >= self._patience.pools_s:
            reasons = "; ".join(sorted(set(self._refused.values())))
            raise SimulationError("cluster", f"no worker may work: {reasons}", SAME)
        if self._patience.workers_s is not None and waited >= self._patience.workers_s:
            raise SimulationError("cluster", f"no worker for {waited:.0f} s", "See docs/cluster.md.")
        if waited >= TELL_AFTER_S and not self._lamented:
            self._lamented = True
            print(f"waiting for workers of {self._client.scheduler.address}", file=sys.stderr)

    def _waited(self) -> float:
        return time.monotonic() - self._changed_at

    def _look(self) -> None:
        """Compare with the scheduler's own list of workers, now and then: news may get lost."""
        if time.monotonic() - self._looked_at < REFRESH_S:
            return
        for worker in self._listed():
            self._introduce(worker)

    def _listed(self) -> set[str]:
        self._looked_at = time.monotonic()
        return set(self._client.scheduler_info(n_workers=-1)["workers"])

    def _open(self, seconds: float) -> None:
        self._connection += 1
        connection = self._connection
        self._client = self._connect(seconds)
        self._stream = self._client.scheduler_comm

        def on_worker(event: tuple[float, Mapping[str, Any]]) -> None:
            action = event[1].get("action")
            if action == "add-worker":
                self._events.put(_Event(JOINED, event[1]["worker"], connection))
            elif action == "remove-worker":
                self._events.put(_Event(LEFT, event[1], connection))

        def on_answer(event: tuple[float, Mapping[str, Any]]) -> None:
            if event[1].get("run") == self._run:
                self._events.put(_Event(TOLD, event[1], connection))

        self._client.subscribe_topic("all", on_worker)
        self._client.subscribe_topic(TOPIC, on_answer)
        self._changed_at = time.monotonic()
        self._lamented = False
        for worker in self._listed():
            self._introduce(worker)

    def _close(self) -> None:
        for task in self._tasks.values():
            task.future.release()
        if self._client is not None:
            self._client.close(timeout=CLOSE_S)

    def _reconnect(self) -> list[Finished | Lost]:
        """Wait for the scheduler to return at its address; what ran is lost."""
        lost: list[Finished | Lost] = [self._lose(key, GONE, False) for key in list(self._tasks)]
        self._close()
        self._introducing.clear()
        self._workers.clear()
        self._refused.clear()
        self._slots.clear()
        print(f"{GONE}; waiting {self._patience.reconnect_s:g} s for its return", file=sys.stderr)
        deadline = time.monotonic() + self._patience.reconnect_s
        while (left := deadline - time.monotonic()) > 0:
            try:
                self._open(left)
                return lost
            except OSError:
                time.sleep(min(TICK_S, left))
        raise SimulationError("cluster", GONE, "Run again: nothing finished is lost.")

    def _submit(self, function: Callable[..., None], key: str, worker: str, *arguments: Any) -> Any:
        future = self._client.submit(
            function,
            self._run,
            key,
            *arguments,
            key=key,
            workers=[worker],
            allow_other_workers=False,
            pure=False,
        )
        connection = self._connection
        future.add_done_callback(lambda _: self._events.put(_Event(ENDED, key, connection)))
        return future

    def _key(self, name: str) -> str:
        """Return a key that neither another try nor another driver of this scheduler uses."""
        return f"{name}-{self._run}-{next(self._numbers)}"


def refusal(answer: Introduction) -> str:
    """Return why a worker may not work; empty where it may."""
    if answer.differing:
        return f"{', '.join(answer.differing)}. {SAME}"
    if not answer.shares_folder:
        return "it does not see the data folder. Share the folder, or set OBJECTFOLDER_STORE to a store."
    return ""


def _error(future: Any) -> BaseException:
    """Return why a future of which nothing was told ended."""
    error = future.exception() if future.status == "error" else None
    return error if isinstance(error, BaseException) else RuntimeError(f"its task was {future.status}")
