"""Runs of toys whose inputs and products travel through a store, as on workers without the data folder."""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path

from toys import Toys

from objectfolder.errors import FormatError, ObjectFolderError
from pipeline.dataset.job import Finished, Job
from pipeline.dataset.task import Call, Outcome, failure_of
from pipeline.run.converge import RunnerFor, Summary, converge
from pipeline.sandbox.child import execute
from pipeline.store.shipping import collect, publish
from pipeline.store.storage import STORE, Store


class Elsewhere:
    """Runs jobs where nothing of the data folder is seen; it does what a cluster's driver and worker do.

    Parameters
    ----------
    root
        The driver's data folder.
    run
        Runs a call where the worker is.
    """

    def __init__(self, root: Path, run: Callable[[Call], Outcome] = execute) -> None:
        self._root = root
        self._store = Store(os.environ[STORE])
        self._store.check()
        self._run = run
        self._jobs: list[Job] = []

    def submit(self, job: Job) -> None:
        self._jobs.append(job)

    def finished(self, on_workers: Callable[[int, int], None]) -> Iterator[Finished]:
        while self._jobs:
            job = self._jobs.pop(0)
            try:
                outcome = publish(job, self._store).run(self._run)
                if outcome.failure is None:
                    collect(job, self._store)
            except FormatError:
                self._jobs.append(job)
                continue
            except ObjectFolderError as error:
                outcome = Outcome(job.object_id, failure_of(job.object_id, error))
            yield Finished(job, outcome)


def elsewhere(root: Path, run: Callable[[Call], Outcome] = execute) -> RunnerFor:
    """Who runs jobs without the data folder."""
    return lambda jobs: contextlib.nullcontext(Elsewhere(root, run))


def flow(toys: Toys, runner_for: RunnerFor) -> list[Summary]:
    """All stages at once."""
    return converge(toys.stages, toys.root, toys.parameters, toys.rows, runner_for)


def made(toys: Toys) -> dict[str, bytes]:
    """Products by path from the root; none may be half-written."""
    paths = [path for path in toys.root.glob("data/*/*") if not path.name.startswith(".")]
    return {path.relative_to(toys.root).as_posix(): path.read_bytes() for path in sorted(paths)}
