"""Runs of toys whose inputs and products travel through a store, as on workers without the data folder."""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from toys import Toys

from objectfolder.errors import FormatError, ObjectFolderError
from pipeline.dataset.crew import Finished, Job, Lost, Slot
from pipeline.dataset.task import Call, Outcome, failure_of
from pipeline.run.converge import CrewFor, Summary, converge
from pipeline.sandbox.child import execute
from pipeline.store.shipping import Courier


class Elsewhere:
    """A crew of one that sees nothing of the data folder; it does what the crew of a cluster does.

    Parameters
    ----------
    root
        The driver's data folder.
    run
        Runs a call where the worker is.
    """

    def __init__(self, root: Path, run: Callable[[Call], Outcome] = execute) -> None:
        self.courier = Courier(root)
        self._run = run
        self._job: Job | None = None

    def slots(self) -> Mapping[str, Slot]:
        return {"elsewhere": Slot("elsewhere", "elsewhere")}

    def memory_bytes(self) -> Mapping[str, int]:
        return {"elsewhere": 1 << 40}

    def may_still_offer(self, needs: frozenset[str]) -> bool:
        return False

    def start(self, job: Job, slot: str) -> None:
        assert self._job is None
        self._job = job

    def wait(self) -> Sequence[Finished | Lost]:
        job, self._job = self._job, None
        assert job is not None
        object_id = job.call.request.object_id
        try:
            outcome = self.courier.publish(job).run(self._run)
            if outcome.failure is None:
                self.courier.collect(job)
        except FormatError as error:
            return [Lost(job, "elsewhere", str(error), counts=False)]
        except ObjectFolderError as error:
            outcome = Outcome(object_id, failure_of(object_id, error))
        return [Finished(job, "elsewhere", outcome)]


def elsewhere(root: Path, run: Callable[[Call], Outcome] = execute) -> CrewFor:
    """Who runs jobs without the data folder."""

    @contextlib.contextmanager
    def crew(jobs: int) -> Iterator[Elsewhere]:
        yield Elsewhere(root, run)

    return crew


def flow(toys: Toys, crew_for: CrewFor) -> list[Summary]:
    """All stages at once."""
    return converge(toys.stages, toys.root, toys.parameters, toys.rows, crew_for)


def made(toys: Toys) -> dict[str, bytes]:
    """Products by path from the root; none may be half-written."""
    paths = [path for path in toys.root.glob("data/*/*") if not path.name.startswith(".")]
    return {path.relative_to(toys.root).as_posix(): path.read_bytes() for path in sorted(paths)}
