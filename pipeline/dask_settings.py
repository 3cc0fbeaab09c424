"""How Dask is set wherever it runs for this project: driver, scheduler, workers."""

from collections.abc import Mapping
from typing import Any

# Task bodies run in child processes, so an event loop that is silent for long is one that is gone.
DEFAULTS: Mapping[str, Any] = {
    "distributed.worker.daemon": False,  # workers have child processes
    "distributed.scheduler.worker-ttl": "2 minutes",
    "distributed.scheduler.allowed-failures": 0,  # what is lost is the driver's to try again
    "distributed.scheduler.work-stealing": False,  # jobs are put where they are to run
    "distributed.admin.tick.limit": "1 hour",
    "distributed.comm.timeouts.connect": "60s",
    "distributed.worker.memory.target": False,  # the memory is the children's, of which Dask knows nothing
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": False,
}


def settings(own: Mapping[str, Any] | None = None) -> Any:
    """Return a context in which these settings hold, those of a place above them."""
    import dask

    return dask.config.set({**DEFAULTS, **(own or {})})
