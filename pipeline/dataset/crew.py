"""Who runs tasks: slots for one task each, on hosts with bounded memory.

A crew is a cluster, one child process, or a simulation in virtual time; `pipeline.run.dispatch` gives each
of them its work in the same way.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from pipeline.dataset.task import Call, Outcome

BLENDER = "blender"
GPU = "gpu"


@dataclass(frozen=True)
class Job:
    """A call with what is expected of it.

    Parameters
    ----------
    call
        What to run.
    seconds
        Expected wall seconds.
    path_seconds
        Expected wall seconds of it and of the longest chain of tasks that waits for it.
    memory_bytes
        Expected peak memory of its process.
    needs
        What the slot must offer (`BLENDER`, `GPU`).
    inputs
        Input name to the fingerprint of a product, or the SHA-256 of a source file: the name under which
        a shared store knows it.
    """

    call: Call
    seconds: float = 0.0
    path_seconds: float = 0.0
    memory_bytes: int = 0
    needs: frozenset[str] = frozenset()
    inputs: Mapping[str, str] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """Unique name among the jobs of a run."""
        return f"{self.call.stage}-{self.call.request.object_id}-{self.call.fingerprint[:8]}"


@dataclass(frozen=True)
class Slot:
    """A place where one task can run.

    Parameters
    ----------
    name
        Unique; the address of a worker.
    host
        Slots of one host share its memory.
    offers
        Pools that it belongs to (`BLENDER`, `GPU`).
    """

    name: str
    host: str
    offers: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Finished:
    """A job that ended in its slot, well or not.

    Parameters
    ----------
    job, slot
        What ran where.
    outcome
        How it ended.
    host
        Whose slot it was, as far as known.
    tries
        How often it was started in all.
    """

    job: Job
    slot: str
    outcome: Outcome
    host: str = ""
    tries: int = 1


@dataclass(frozen=True)
class Lost:
    """A job whose slot or process went away under it; it may be tried again.

    Parameters
    ----------
    job, slot
        What ran where.
    reason
        What is known, for a person.
    counts
        Whether the job itself may be the reason: its own process was killed, not its worker.
    """

    job: Job
    slot: str
    reason: str
    counts: bool = True


class Crew(Protocol):
    """Slots that run jobs."""

    def slots(self) -> Mapping[str, Slot]:
        """Return the slots there are now, free or not, by name."""
        ...

    def memory_bytes(self) -> Mapping[str, int]:
        """Return the memory that tasks may take on each host."""
        ...

    def may_still_offer(self, needs: frozenset[str]) -> bool:
        """Whether slots that offer `needs` may still join."""
        ...

    def start(self, job: Job, slot: str) -> None:
        """Begin a job in a free slot, and return at once."""
        ...

    def wait(self) -> Sequence[Finished | Lost]:
        """Wait until jobs end, the slots change, or no more are to join; the last two return nothing.

        Raises
        ------
        SimulationError
            The crew is gone. What is finished stays finished.
        """
        ...
