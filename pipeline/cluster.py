"""Where calls run: a child process for one or two of them, else a Dask cluster.

``DASK_SCHEDULER_ADDRESS`` names a running scheduler; else ``cluster/local.yaml`` (or the file that
``OBJECTFOLDER_CLUSTER`` names) describes a cluster on this machine. Workers share the data folder.
"""

import contextlib
import logging
import os
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml

from objectfolder.errors import InputError, SimulationError
from pipeline.isolation import Child, ChildSettings
from pipeline.task import Call, Failure, Outcome

ADDRESS = "DASK_SCHEDULER_ADDRESS"
PLACE = "OBJECTFOLDER_CLUSTER"
FEW = 1  # calls for which a cluster would cost more than it gives
WINDOW = 2  # calls submitted for each worker: enough to keep it busy, few enough to keep the order


@dataclass(frozen=True)
class Place:
    """A cluster on this machine.

    Parameters
    ----------
    workers
        Worker processes; None for one a core.
    child
        How the child processes of the workers run.
    dask
        Settings for Dask.
    """

    workers: int | None = None
    child: ChildSettings = field(default_factory=ChildSettings)
    dask: dict[str, Any] = field(default_factory=dict)


def read_place(root: Path) -> Place:
    """Read the description of the cluster; without a file, the defaults.

    Raises
    ------
    InputError
        A file that is missing, is no YAML, or has an unknown key.
    """
    named = os.environ.get(PLACE)
    path = Path(named) if named else root / "cluster" / "local.yaml"
    if not named and not path.is_file():
        return Place()
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, yaml.YAMLError) as error:
        raise InputError(str(path), f"cannot be read ({error})", f"Set {PLACE} to a YAML file.") from error
    known = {"workers", "dask", *(entry.name for entry in fields(ChildSettings))}
    for key in content:
        if key not in known:
            raise InputError(str(path), f"unknown key {key!r}", f"Known are {', '.join(sorted(known))}.")
    child = {entry.name: content[entry.name] for entry in fields(ChildSettings) if entry.name in content}
    return Place(content.get("workers"), ChildSettings(**child), content.get("dask") or {})


def run_calls(calls: Sequence[Call], place: Place, root: Path) -> Iterator[Outcome]:
    """Run calls in the order given, as far as workers are free; yield outcomes as they come.

    Raises
    ------
    SimulationError
        The cluster is lost. What is finished stays finished.
    """
    if len(calls) <= FEW and not os.environ.get(ADDRESS):
        with Child(root, place.child) as child:
            for call in calls:
                yield child.run(call)
        return
    yield from _run_on_dask(calls, place, root)


def _run_on_dask(calls: Sequence[Call], place: Place, root: Path) -> Iterator[Outcome]:
    import dask
    from distributed import CancelledError, as_completed
    from distributed.scheduler import KilledWorker

    with dask.config.set(place.dask), _client(place, len(calls)) as client:
        waiting = iter(calls)
        running: dict[str, Call] = {}

        def submit_next() -> Any:
            call = next(waiting, None)
            if call is None:
                return None
            key = f"{call.stage}-{call.request.object_id}-{call.fingerprint[:8]}"
            running[key] = call
            return client.submit(run_on_worker, call, place.child, root, key=key, pure=False)

        workers = max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
        window = (submit_next() for _ in range(WINDOW * workers))
        completed = as_completed([future for future in window if future is not None], loop=client.loop)
        for future in completed:
            call = running.pop(future.key)
            try:
                outcome = future.result()
            except KilledWorker:
                remedy = "Out of memory, most likely: run fewer workers."
                lost = Failure(call.request.object_id, "the workers that ran it were killed", remedy)
                outcome = Outcome(call.request.object_id, lost)
            except CancelledError as error:
                finding = "the scheduler is gone"
                raise SimulationError("cluster", finding, "Run again: nothing finished is lost.") from error
            future.release()
            if (more := submit_next()) is not None:
                completed.add(more)
            yield outcome


@contextlib.contextmanager
def _client(place: Place, calls: int) -> Iterator[Any]:
    from dask.system import CPU_COUNT
    from distributed import Client, LocalCluster

    address = os.environ.get(ADDRESS)
    if address:
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(1)
            yield client
        return
    workers = min(place.workers or CPU_COUNT, calls)
    with (
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=0,  # the memory is the children's, which the nanny does not see
            host="127.0.0.1",
            dashboard_address=os.environ.get("OBJECTFOLDER_DASHBOARD", "127.0.0.1:0"),
            silence_logs=logging.ERROR,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


_own = threading.local()


def run_on_worker(call: Call, settings: ChildSettings, root: Path) -> Outcome:
    """Run a call in the child process of this worker thread."""
    child = getattr(_own, "child", None)
    if child is None:
        child = _own.child = Child(root, settings)
    outcome: Outcome = child.run(call)
    return outcome
