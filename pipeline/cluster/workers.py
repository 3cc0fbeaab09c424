"""The workers of a scheduler, as the driver of a run sees them."""

import math
import sys
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from objectfolder.errors import SimulationError
from pipeline.cluster.worker_plugin import MEMORY_BYTES, TOPIC

UNKNOWN_BYTES = 1 << 60  # more than any worker has
LOOK_S = 2.0  # between looks at the list of workers
TELL_AFTER_S = 10.0  # without a worker
GONE = "the scheduler went away"


@dataclass
class Workers:
    """Workers that were admitted, and why others were not.

    Parameters
    ----------
    client
        A connected client.
    name
        Resource that an admitted worker has (`pipeline.cluster.worker_plugin.Admission`).
    workers_s
        Seconds to wait while the scheduler has no worker; None for ever.
    pools_s
        Seconds to wait, after a worker joined or left, for others that offer what none does.
    """

    client: Any
    name: str
    workers_s: float | None
    pools_s: float
    threads: int = 0
    _admitted: dict[str, Mapping[str, float]] = field(default_factory=dict)  # their resources
    _largest: dict[frozenset[str], int] = field(default_factory=dict)  # `largest_bytes` since the last look
    _refused: dict[str, str] = field(default_factory=dict)
    _changed_at: float = field(default_factory=time.monotonic)
    _looked_at: float = -math.inf
    _told: bool = False

    def listen(self) -> None:
        """Begin to receive messages of workers that are not admitted."""
        self.client.subscribe_topic(TOPIC, self._hear)

    def look(self) -> bool:
        """Update the list if its interval has passed; return whether it was updated.

        Raises
        ------
        SimulationError
            The scheduler is gone, or no worker may work and none joined within the limits.
        """
        now = time.monotonic()
        if now - self._looked_at < LOOK_S:
            return False
        self._looked_at = now
        try:
            if self.client.status != "running":
                raise OSError(self.client.status)
            infos = self.client.scheduler_info(n_workers=-1)["workers"]
        except OSError as error:
            raise gone() from error
        offers = {
            address: worker["resources"]
            for address, worker in infos.items()
            if worker["resources"].get(self.name)
        }
        if offers.keys() != self._admitted.keys():
            self._changed_at = now
        self._admitted = offers
        self._largest.clear()
        self.threads = sum(infos[address]["nthreads"] for address in offers)
        if not offers:
            reasons = [why for address, why in list(self._refused.items()) if address in infos]
            self._check_wait(now - self._changed_at, reasons if len(reasons) == len(infos) else [])
        return True

    def largest_bytes(self, needs: frozenset[str]) -> int:
        """Return the memory of the largest worker that offers `needs`; `UNKNOWN_BYTES` without any."""
        if needs not in self._largest:
            sizes = (int(worker[MEMORY_BYTES]) for worker in self._able(needs))
            self._largest[needs] = max(sizes, default=UNKNOWN_BYTES)
        return self._largest[needs]

    def threads_that_offer(self, needs: Collection[str]) -> int:
        """Return the threads of all workers that offer `needs`."""
        return sum(int(worker[self.name]) for worker in self._able(needs))

    def missing(self, needs: Collection[str]) -> str:
        """Return what no worker offers, though workers are there and others were waited for; else nothing."""
        if not self._admitted or self._able(needs):
            return ""
        if time.monotonic() - self._changed_at < self.pools_s:
            return ""
        pools = {pool for worker in self._admitted.values() for pool in worker if worker[pool]}
        return ", ".join(sorted(set(needs) - pools)) or "all it needs in one place"

    def _able(self, needs: Collection[str]) -> list[Mapping[str, float]]:
        return [worker for worker in self._admitted.values() if all(worker.get(need) for need in needs)]

    def _check_wait(self, waited_s: float, reasons: Collection[str]) -> None:
        """Print that no worker has joined; end the run where none can be expected any more."""
        if reasons and waited_s >= self.pools_s:
            raise SimulationError("cluster", "no worker may work", "; ".join(sorted(set(reasons))))
        if self.workers_s is not None and waited_s >= self.workers_s:
            raise SimulationError(
                "cluster",
                f"no worker for {waited_s:.0f} s",
                "Look at its log, or raise workers_within_s of the place.",
            )
        if waited_s >= TELL_AFTER_S and not self._told:
            self._told = True
            print(f"waiting for a worker at {self.client.scheduler.address}", file=sys.stderr)

    def _hear(self, event: tuple[float, Mapping[str, Any]]) -> None:
        """Handle the message that a worker was not admitted; called from the client's event loop."""
        _, message = event
        if message["name"] == self.name:
            self._refused[message["worker"]] = message["problem"]
            self._changed_at = time.monotonic()
            print(f"worker {message['worker']} gets no work: {message['problem']}", file=sys.stderr)


def gone() -> SimulationError:
    """Return the error of a run whose scheduler ended."""
    return SimulationError("cluster", GONE, "Run again: nothing finished is lost.")
