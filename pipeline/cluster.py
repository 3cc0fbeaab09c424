"""Where calls run: a child process for one or two of them, else a Dask cluster.

``DASK_SCHEDULER_ADDRESS`` names a running scheduler; else ``cluster/local.yaml`` (or the file that
``OBJECTFOLDER_CLUSTER`` names) describes a cluster on this machine. Workers share the data folder.
"""

import contextlib
import functools
import logging
import os
import threading
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from objectfolder.errors import SimulationError
from pipeline.crew import Crew
from pipeline.dask_crew import DaskCrew, Patience
from pipeline.environment_check import environment_of
from pipeline.isolation import Child, ChildSettings
from pipeline.local_crew import LocalCrew
from pipeline.places import ADDRESS, Place, read_place
from pipeline.task import Call, Failure, Outcome

__all__ = ["Place", "crew", "read_place", "run_calls"]

FEW = 1  # calls for which a cluster would cost more than it gives
WINDOW = 2  # calls submitted for each worker: enough to keep it busy, few enough to keep the order


@contextlib.contextmanager
def crew(place: Place, root: Path, jobs_at_most: int, stages: Iterable[Any] = ()) -> Iterator[Crew]:
    """Start or join what a place describes.

    Parameters
    ----------
    place
        Where to run.
    root
        The data folder, absolute.
    jobs_at_most
        Jobs that there will be: no more workers are started, and no cluster for a single one.
    stages
        Stages (`pipeline.stage.Stage`) to be run: what workers from elsewhere must have the code of.
    """
    import dask

    address = os.environ.get(ADDRESS)
    if jobs_at_most <= FEW and not address:
        with LocalCrew(root, place.child) as alone:
            yield alone
        return
    with dask.config.set(place.dask), contextlib.ExitStack() as stack:
        patience = Patience()
        wanted = None
        if address:
            wanted = environment_of(stages)
        else:
            cluster = stack.enter_context(_local_cluster(place, jobs_at_most))
            address = cluster.scheduler_address
            patience = Patience(workers_s=120.0)
        connect = functools.partial(_connected, address)
        yield stack.enter_context(DaskCrew(connect, root, place.child, wanted, None, patience))


def _connected(address: str, seconds: float) -> Any:
    from distributed import Client

    return Client(address, timeout=seconds, set_as_default=False)


def _local_cluster(place: Place, jobs_at_most: int) -> Any:
    from dask.system import CPU_COUNT
    from distributed import LocalCluster

    return LocalCluster(
        n_workers=min(place.workers or CPU_COUNT, jobs_at_most),
        threads_per_worker=1,
        memory_limit=0,  # the memory is the children's, which the nanny does not see
        host="127.0.0.1",
        dashboard_address=os.environ.get("OBJECTFOLDER_DASHBOARD", "127.0.0.1:0"),
        silence_logs=logging.ERROR,
    )


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
            return client.submit(_run_call, call, place.child, root, key=key, pure=False)

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


def _run_call(call: Call, settings: ChildSettings, root: Path) -> Outcome:
    child = getattr(_own, "child", None)
    if child is None:
        child = _own.child = Child(root, settings)
    outcome: Outcome = child.run(call)
    return outcome
