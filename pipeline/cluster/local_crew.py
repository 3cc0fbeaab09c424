"""A crew of one child process on this machine: for a single call, a cluster would cost more than it gives."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

from pipeline.cluster.worker_task import offers_here, usable_bytes
from pipeline.dataset.crew import Finished, Job, Lost, Slot
from pipeline.sandbox.isolation import Child, ChildSettings, ProcessKilled

HERE = "here"


class LocalCrew:
    """One slot; `start` remembers a job, `wait` runs it.

    Parameters
    ----------
    root
        The data folder, absolute.
    settings
        How the child process runs.
    memory_gb
        Memory that tasks may take; None for most of what this host has.
    """

    def __init__(self, root: Path, settings: ChildSettings, memory_gb: float | None = None) -> None:
        self._child = Child(root, settings)
        self._memory_bytes = usable_bytes(memory_gb)
        self._slot = Slot(HERE, HERE, frozenset(offers_here()))
        self._job: Job | None = None

    def __enter__(self) -> "LocalCrew":
        self._child.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._child.__exit__(kind, error, trace)

    def slots(self) -> Mapping[str, Slot]:
        """Return the one slot."""
        return {HERE: self._slot}

    def memory_bytes(self) -> Mapping[str, int]:
        """Return the memory that tasks may take here."""
        return {HERE: self._memory_bytes}

    def may_still_offer(self, needs: frozenset[str]) -> bool:
        """Return whether the slot offers `needs`: nobody else joins."""
        return needs <= self._slot.offers

    def start(self, job: Job, slot: str) -> None:
        """Remember a job."""
        self._job = job

    def wait(self) -> Sequence[Finished | Lost]:
        """Run the job that was started."""
        job, self._job = self._job, None
        if job is None:
            return ()
        try:
            return (Finished(job, HERE, self._child.run(job.call, job.memory_bytes)),)
        except ProcessKilled as error:
            return (Lost(job, HERE, str(error)),)
