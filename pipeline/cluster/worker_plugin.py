"""A plugin of Dask workers: it checks the environment of a worker, then grants its resources.

Every task asks for `Admission.name` and for memory, which a worker has only once it was admitted. So one
that would compute other numbers gets no work. This module, `pipeline.cluster.pools` and
`pipeline.cluster.steady_clock` are sent to workers by value, because a worker may lack the project's code.
"""

import asyncio
import contextlib
import os
import subprocess
from dataclasses import dataclass
from typing import Any

from distributed import Status, WorkerPlugin
from distributed.system import MEMORY_LIMIT

from objectfolder.child_process import module_command, search_path
from pipeline.cluster.pools import MEMORY, USABLE, stated
from pipeline.cluster.steady_clock import use_steady_clock

TOPIC = "objectfolder"
MEMORY_BYTES = "memory_bytes"  # whole numbers, for Dask adds and subtracts them
SAME = "Install on it what the driver has: the same checkout, and requirements.lock."
SHARE = "Share the folder, or set OBJECTFOLDER_STORE to a store that the worker reaches."
GIVEN_UP = ("executing", "released")  # Dask's state of a running task that was cancelled
CHECK_LIMIT_S = 600.0


@dataclass(eq=False)
class Admission(WorkerPlugin):
    """Admits a worker whose environment is the driver's, and ends child processes of cancelled tasks.

    Parameters
    ----------
    name
        Resource that an admitted worker is granted; another one for each environment and data folder.
    environment
        What a worker must have, as JSON (`pipeline.cluster.environment_check`); None where it has it by
        construction.
    folder, marker
        The data folder, from which the code is taken where the worker sees it, and a file in it by which the
        worker knows that.
    folder_needed
        Whether a worker that does not see the folder is refused, because there is no store to send files by.
    memory_gb
        Memory of a worker that tasks may take; None for what the worker says.
    """

    name: str
    environment: str | None
    folder: str
    marker: str
    folder_needed: bool
    memory_gb: float | None

    def setup(self, worker: Any) -> None:
        """Begin to check a worker, which may still be starting."""
        use_steady_clock()
        self._checking = asyncio.create_task(self._admit(worker))

    def transition(self, key: str, start: str, finish: str, **_: Any) -> None:
        """End the child process of a task that was cancelled."""
        if (start, finish) == GIVEN_UP:
            with contextlib.suppress(ImportError):  # then no task ran here
                from pipeline.cluster.run_task import give_up

                give_up(key)

    async def _admit(self, worker: Any) -> None:
        try:
            problem = await asyncio.to_thread(self._difference)
            if not problem:
                await self._grant(worker)
        except Exception as error:  # the driver has to know every reason why this worker does not work
            problem = f"{type(error).__name__}: {error}"
        if problem:
            worker.log_event(TOPIC, {"name": self.name, "worker": worker.address, "problem": problem})
            if worker.state.total_resources.get(self.name):  # admitted before its code changed
                await worker.set_resources(**{self.name: 0})

    async def _grant(self, worker: Any) -> None:
        threads = worker.state.nthreads
        pools = dict.fromkeys(stated(worker.state.total_resources), threads)
        memory_bytes = self._usable_bytes(worker.memory_manager.memory_limit)
        await worker.set_resources(**{self.name: threads, MEMORY_BYTES: memory_bytes, **pools})
        # The scheduler looks at tasks that wait for resources when a worker begins to work, not at a grant.
        worker.status = Status.paused
        worker.status = Status.running

    def _difference(self) -> str:
        """Return why this worker may not work, as seen from where its children run; empty where it may."""
        sees_folder = os.access(self.marker, os.R_OK)
        if self.folder_needed and not sees_folder:
            return f"it does not see the data folder {self.folder}. {SHARE}"
        if self.environment is None:
            return ""
        answer = subprocess.run(
            module_command("pipeline.cluster.environment_check"),
            input=self.environment,
            capture_output=True,
            text=True,
            cwd=self.folder if sees_folder else None,
            timeout=CHECK_LIMIT_S,
            env={**os.environ, "PYTHONPATH": search_path()},
            check=False,
        )
        if answer.returncode:
            lines = answer.stderr.strip().splitlines() or [f"exit {answer.returncode}"]
            return f"its environment cannot be read ({lines[-1]}). {SAME}"
        return f"{answer.stdout.strip()}. {SAME}" if answer.stdout.strip() else ""

    def _usable_bytes(self, limit_bytes: int | None) -> int:
        """Return what tasks may take: what the worker or the place says, else most of what Dask allots."""
        stated_gb = os.environ.get(MEMORY) or self.memory_gb
        return int(1e9 * float(stated_gb) if stated_gb else USABLE * (limit_bytes or MEMORY_LIMIT))
