"""A job: the task of one object in a stage; its end; and the protocol of what runs it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from pipeline.dataset.task import Call, Failure, Outcome

BLENDER = "blender"
GPU = "gpu"


@dataclass(frozen=True)
class Job:
    """A call with what is expected of it.

    Attributes
    ----------
    call : what to run
    seconds : expected seconds
    path_seconds : expected seconds of it and of the longest chain of tasks that waits for it
    memory_bytes : expected peak memory of its process
    needs : what the worker must offer (`BLENDER`, `GPU`)
    inputs : input name to the fingerprint of a product, or the SHA-256 of a source file: the name under which
        a shared store knows it
    """

    call: Call
    seconds: float = 0.0
    path_seconds: float = 0.0
    memory_bytes: int = 0
    needs: frozenset[str] = frozenset()
    inputs: Mapping[str, str] = field(default_factory=dict)

    @property
    def object_id(self) -> str:
        """The object."""
        return self.call.request.object_id


@dataclass(frozen=True)
class Finished:
    """A job that ended, well or not.

    Attributes
    ----------
    job, outcome : what ran, and how it ended
    worker, host : where it ran; empty where it did not
    tries : how often it was started by this run
    """

    job: Job
    outcome: Outcome
    worker: str = ""
    host: str = ""
    tries: int = 1


def failed(job: Job, error: str, remedy: str) -> Outcome:
    """Return the outcome of a job whose task returned none."""
    return Outcome(job.object_id, Failure(job.object_id, error, remedy))


class Runner(Protocol):
    """Who runs jobs: the workers of a cluster, or one process."""

    def submit(self, job: Job) -> None:
        """Accept a job, to be run before those with fewer `path_seconds`."""
        ...

    def finished(self, on_workers: Callable[[int, int], None]) -> Iterator[Finished]:
        """Yield jobs as they end, until none is left; more may be submitted meanwhile.

        Parameters
        ----------
        on_workers
            Told now and then how many tasks run, and how many can run at once.

        Raises
        ------
        SimulationError
            Nobody can run jobs any more. What is finished stays finished.
        """
        ...
