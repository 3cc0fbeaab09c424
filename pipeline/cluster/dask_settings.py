"""Dask's settings in driver, scheduler and workers."""

import os
from collections.abc import Mapping
from typing import Any

# Task bodies run in child processes, so an event loop that is silent for long has ended.
DEFAULTS: Mapping[str, Any] = {
    "distributed.worker.daemon": False,  # workers have child processes
    "distributed.scheduler.worker-ttl": "60s",
    "distributed.deploy.lost-worker-timeout": "2 minutes",  # for a worker to restart on a busy machine
    "distributed.admin.tick.limit": "1 hour",
    # By default, ticks and samples take 2 to 3 % of a core in every process; with these, a fifth of that.
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.profile.enabled": False,  # it would show a thread that waits for a child process
    "distributed.comm.timeouts.connect": "60s",
    "distributed.worker.memory.target": False,  # the memory is the children's, of which Dask knows nothing
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": False,
}


def settings(own: Mapping[str, Any] | None = None) -> Any:
    """Return a context in which these settings hold; ``DASK_...`` variables and those of a place go first."""
    import dask
    import distributed  # noqa: F401  (its defaults must be there before, or they would go with the context)

    free = {key: value for key, value in DEFAULTS.items() if _variable(key) not in os.environ}
    return dask.config.set({**free, **(own or {})})


def _variable(key: str) -> str:
    """Return the environment variable from which Dask reads a setting."""
    return f"DASK_{key.upper().replace('.', '__').replace('-', '_')}"
