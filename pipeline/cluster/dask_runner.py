"""Running jobs on the workers of a Dask scheduler, which decides what runs where and when.

Dask has three means that this module does not use, for each would lose a promise:

- ``retries=`` runs a function again that raised an error, on the same resources. Here a task body that
  fails has an outcome, the same on every worker. A killed process is tried again with more memory.
- ``as_completed`` yields futures of Dask alone, wakes ten times a second, and has one deadline for all. Here
  files on their way to a store end beside futures, and the workers are looked at while nothing ends.
- Futures as inputs of tasks: the content of the files that a task reads decides whether it runs at all.
"""

import contextlib
import hashlib
import heapq
import itertools
import os
import queue
import secrets
from asyncio import CancelledError
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cloudpickle
from distributed import KilledWorker

from objectfolder.errors import FormatError
from pipeline.cluster import pools, steady_clock, worker_plugin
from pipeline.cluster.environment_check import Environment
from pipeline.cluster.places import Place
from pipeline.cluster.run_task import Answer, run_task
from pipeline.cluster.steady_clock import use_steady_clock
from pipeline.cluster.worker_plugin import MEMORY_BYTES, Admission
from pipeline.cluster.workers import LOOK_S, Workers, gone
from pipeline.dataset.job import Finished, Job, failed
from pipeline.dataset.products import STATE
from pipeline.dataset.task import Outcome, failure_of
from pipeline.store.shipping import Shipment, collect, publish
from pipeline.store.storage import STORE, Store

MOST_KILLS = 2  # of a task's own process, after which it fails
MOST_DAMAGED = 3  # copies of a product in the store, after which its task fails
RESULT_S = 30.0  # within which a result of a few bytes arrives
# Tasks that Dask has at once of those that need the same pools. Others wait here, so that a scheduler with a
# hundred thousand tasks to come stays small, and what turns out to be urgent does not queue behind them.
TASKS_A_THREAD, FEWEST_TASKS = 4, 1000
TRANSFERS = 8  # tasks whose files are on their way to or from the store at once
FEWER = "Out of memory, most likely: run fewer workers, or lower the settings of this stage."

for module in (worker_plugin, pools, steady_clock):
    cloudpickle.register_pickle_by_value(module)


@dataclass(eq=False)
class _Task:
    """A job on its way."""

    job: Job
    memory_bytes: int
    tries: int = 0
    kills: int = 0
    damaged: int = 0
    suspected: bool = False  # workers died while they had it
    shipment: Shipment | None = None
    answer: Answer | None = None
    step: Any = None  # the future of what happens to it now


Needs = frozenset[str]
Then = Callable[[_Task], Finished | None]  # what follows the end of a step


class DaskRunner:
    """Runs jobs on the workers of a scheduler that have this process's environment.

    Parameters
    ----------
    client
        A connected client.
    root
        The data folder, absolute.
    place
        How long to wait for workers, how their child processes run, and the memory that tasks may take.
    environment
        What a worker must have; None where it is this one by construction.
    """

    def __init__(self, client: Any, root: Path, place: Place, environment: Environment | None = None) -> None:
        requirement = environment.model_dump_json() if environment else None
        folder_needed = not os.environ.get(STORE)
        digest = hashlib.sha256(f"{root} {folder_needed} {requirement}".encode()).hexdigest()
        name = f"objectfolder-{digest[:12]}"
        self._client = client
        self._settings = place.child
        self._run = secrets.token_hex(8)
        self._root = root
        self._marker = root / STATE / f"shared-{self._run}"  # workers that share the folder see it
        self._plugin = Admission(
            name, requirement, str(root), str(self._marker), folder_needed, place.memory_gb
        )
        self._workers = Workers(client, name, place.worker_limit_s, place.pools_within_s)
        self._numbers = itertools.count()
        self._tasks: set[_Task] = set()  # those that have begun
        self._waiting: dict[Needs, list[tuple[float, int, _Task]]] = defaultdict(list)  # heaps, urgent first
        self._begun: Counter[Needs] = Counter()
        self._most: dict[Needs, int] = {}  # tasks that may have begun, since the last look at the workers
        self._largest: dict[Needs, int] = {}  # bytes of the largest worker at the last look
        self._suspects: list[_Task] = []  # they run one at a time, after all others
        self._ended: queue.SimpleQueue[tuple[_Task, Any, Then]] = queue.SimpleQueue()
        self._transfers = ThreadPoolExecutor(TRANSFERS, thread_name_prefix="store")
        self._store: Any = None  # once a worker was found that does not see the data folder

    def __enter__(self) -> "DaskRunner":
        self._marker.parent.mkdir(exist_ok=True)
        self._marker.touch()
        self._workers.listen()
        use_steady_clock()
        self._client.run_on_scheduler(use_steady_clock)
        with _workers_may_die():
            self._client.register_plugin(self._plugin, self._plugin.name)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        # After an error the plugin stays, to end the child processes of tasks that are cancelled now.
        if error is None and not self._tasks:
            with _workers_may_die():
                self._client.unregister_worker_plugin(self._plugin.name)
        self._transfers.shutdown(cancel_futures=True)
        for task in self._tasks:
            if task.step is not None and hasattr(task.step, "release"):
                task.step.release()
        self._marker.unlink(missing_ok=True)

    def submit(self, job: Job) -> None:
        """Accept a job; those with the longest chain behind them run first."""
        entry = (-job.path_seconds, next(self._numbers), _Task(job, job.memory_bytes))
        heapq.heappush(self._waiting[job.needs], entry)
        self._begin_waiting()

    def finished(self, on_workers: Callable[[int, int], None]) -> Iterator[Finished]:
        """Yield jobs as they end (see `pipeline.dataset.job.Runner`).

        A task whose process is killed is tried again with all memory of a worker, and fails the second time.
        Dask runs the tasks of a worker that dies elsewhere. It gives up those that were on too many such
        workers, running there or waiting. These run one by one after all others, so that only the one that
        kills its worker fails.
        """
        while self._begin_waiting() or self._tasks or self._suspects:
            if not self._tasks:
                self._begin(self._suspects.pop())
            if self._workers.look():
                yield from self._review()
            on_workers(min(len(self._tasks), self._workers.threads), self._workers.threads)
            with contextlib.suppress(queue.Empty):
                task, step, then = self._ended.get(timeout=LOOK_S)
                if task.step is step and (ended := then(task)) is not None:
                    yield ended

    def _begin_waiting(self) -> bool:
        """Hand the most urgent tasks that wait here to Dask, as far as it takes them; return whether any."""
        any_begun = False
        for needs, tasks in self._waiting.items():
            if needs not in self._most:
                threads = self._workers.threads_that_offer(needs)
                self._most[needs] = max(FEWEST_TASKS, TASKS_A_THREAD * threads)
            while tasks and self._begun[needs] < self._most[needs]:
                self._begin(heapq.heappop(tasks)[-1])
                any_begun = True
        return any_begun

    def _begin(self, task: _Task) -> None:
        self._tasks.add(task)
        self._begun[task.job.needs] += 1
        self._transfer_or_send(task)

    def _end(self, task: _Task) -> None:
        self._tasks.remove(task)
        self._begun[task.job.needs] -= 1

    def _transfer_or_send(self, task: _Task) -> None:
        if self._store is None or task.shipment is not None:
            self._send(task)
        else:
            step = self._transfers.submit(publish, task.job, self._store)
            self._await(task, step, self._after_publishing)

    def _send(self, task: _Task) -> None:
        job = task.job
        task.memory_bytes = min(task.memory_bytes, self._workers.largest_bytes(job.needs))
        step = self._client.submit(
            run_task,
            job.call,
            task.shipment,
            self._root,
            self._marker,
            self._settings,
            job.memory_bytes,
            key=self._key(job),
            priority=job.path_seconds,
            resources={
                self._plugin.name: 1,
                MEMORY_BYTES: task.memory_bytes,
                **dict.fromkeys(job.needs, 1),
            },
            pure=False,
        )
        self._await(task, step, self._after_run)

    def _key(self, job: Job) -> str:
        """Return a key that no other try and no other driver of this scheduler uses.

        Dask takes what stands before the first hyphen for the kind of a task: its bars, its colours, and the
        mean seconds by which it shares out work are a stage's.
        """
        return f"{job.call.stage}-{next(self._numbers)}-{self._run}-{job.object_id}"

    def _await(self, task: _Task, step: Any, then: Then) -> None:
        task.step = step
        step.add_done_callback(lambda _: self._ended.put((task, step, then)))

    def _after_publishing(self, task: _Task) -> Finished | None:
        if (error := task.step.exception()) is not None:
            return self._finish(task, outcome_of(task.job, error))
        task.shipment = task.step.result()
        self._send(task)
        return None

    def _after_run(self, task: _Task) -> Finished | None:
        step = task.step
        if step.status == "cancelled":
            raise gone()
        if step.status == "error":
            return self._after_error(task, step.exception())
        try:
            task.answer = answer = step.result(timeout=RESULT_S)
        except TimeoutError:  # its worker died with the result; Dask runs it again
            self._await(task, step, self._after_run)
            return None
        except (CancelledError, OSError) as error:  # a connection that closes is an OSError of Dask's
            raise gone() from error
        step.release()
        if answer.outcome is None and not answer.killed:
            return self._after_unseen_folder(task)
        task.tries += 1
        if answer.killed or answer.outcome is None:
            return self._after_kill(task)
        if answer.shipped and answer.outcome.failure is None:
            step = self._transfers.submit(collect, task.job, self._store)
            self._await(task, step, self._after_collecting)
            return None
        return self._finish(task, answer.outcome)

    def _after_error(self, task: _Task, error: BaseException) -> Finished | None:
        """Take the end of a task that failed around its call, not in it."""
        if not isinstance(error, KilledWorker):
            return self._finish(task, outcome_of(task.job, error))
        if task.suspected:
            return self._finish(task, failed(task.job, f"workers died under it ({error})", FEWER))
        task.suspected = True
        self._end(task)
        self._suspects.append(task)
        return None

    def _after_kill(self, task: _Task) -> Finished | None:
        """Try a task again whose process was killed, with all memory of a worker: the likeliest reason."""
        assert task.answer is not None
        task.kills += 1
        if task.kills >= MOST_KILLS:
            return self._finish(task, failed(task.job, f"{task.answer.killed}, {MOST_KILLS} times", FEWER))
        task.memory_bytes = max(task.memory_bytes, self._workers.largest_bytes(task.job.needs))
        self._send(task)
        return None

    def _after_unseen_folder(self, task: _Task) -> Finished | None:
        """Send a task again by the store, for its worker does not see the data folder."""
        if self._store is None:
            self._store = Store(os.environ[STORE])
            self._store.check()
        self._transfer_or_send(task)
        return None

    def _after_collecting(self, task: _Task) -> Finished | None:
        assert task.answer is not None
        assert task.answer.outcome is not None
        error = task.step.exception()
        if isinstance(error, FormatError) and task.damaged < MOST_DAMAGED:
            task.damaged += 1
            self._send(task)
            return None
        outcome = task.answer.outcome if error is None else outcome_of(task.job, error)
        return self._finish(task, outcome)

    def _review(self) -> Iterator[Finished]:
        """Send tasks again that ask for more memory than any worker has; end those that no worker can run."""
        self._most.clear()
        kinds = [needs for needs, count in self._begun.items() if count or self._waiting[needs]]
        missing = {needs: self._workers.missing(needs) for needs in kinds}
        if missing and all(missing.values()):  # those that can run run first
            for needs in kinds:
                tasks = [task for *_, task in self._waiting.pop(needs, ())]
                self._tasks.update(tasks)
                self._begun[needs] += len(tasks)
            for task in list(self._tasks):
                problem = f"no worker offers {missing[task.job.needs]}"
                remedy = "Add workers that do (the place in cluster/ says what they offer)."
                yield self._finish(task, failed(task.job, problem, remedy))
            return
        largest = {needs: self._workers.largest_bytes(needs) for needs in kinds}
        if largest == self._largest:
            return
        self._largest = largest
        for task in list(self._tasks):
            is_sent = hasattr(task.step, "release")  # else its files are on their way
            if is_sent and task.memory_bytes > largest[task.job.needs]:
                task.step.release()
                self._send(task)

    def _finish(self, task: _Task, outcome: Outcome) -> Finished:
        self._end(task)
        worker, host = (task.answer.worker, task.answer.host) if task.answer else ("", "")
        return Finished(task.job, outcome, worker, host, max(1, task.tries))


def _workers_may_die() -> contextlib.AbstractContextManager[None]:
    """Return a context for a change of plugins, which tells every worker.

    Dask raises an error where a worker dies before it answers, though the change holds for the others and for
    those to come. That the scheduler is gone shows at the next look.
    """
    return contextlib.suppress(OSError)


def outcome_of(job: Job, error: BaseException) -> Outcome:
    """Return the outcome of a job that ended with an error outside its process."""
    return Outcome(job.object_id, failure_of(job.object_id, error))
