"""Starting, or joining, the Dask cluster that a place describes."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from objectfolder.errors import SimulationError
from pipeline.cluster import tls
from pipeline.cluster.dask_settings import settings
from pipeline.cluster.places import CUDA, LOCAL, Place
from pipeline.cluster.starting import make_cluster, start_workers
from pipeline.sandbox import scratch

HERE = (LOCAL, CUDA)  # classes whose workers run this installation


@contextlib.contextmanager
def connect(place: Place, root: Path, tasks_at_most: int) -> Iterator[Any]:
    """Start or join the cluster that a place describes; yield a connected client, and end what was started.

    The client's scheduler may have no worker yet, and workers may come and go. A worker that does not start,
    or ends, is started again.

    Parameters
    ----------
    place
        Where to run.
    root
        The data folder, absolute.
    tasks_at_most
        Tasks that there will be: no more threads are asked for.

    Yields
    ------
    distributed.Client
        It is not the default client of this process.

    Raises
    ------
    InputError
        The place names a class that is not installed, or an argument or certificate that cannot be.
    SimulationError
        The cluster does not start, or the scheduler does not answer.
    """
    with contextlib.ExitStack() as stack:
        scratch.sweep()
        own = dict(place.dask)
        if place.starts in HERE:
            dask_files = scratch.Scratch("dask")
            stack.callback(dask_files.close)
            own.setdefault("temporary-directory", str(dask_files.path))
        stack.enter_context(settings(own))
        security = tls.security(place, root)
        cluster = None
        if place.starts:
            cluster = make_cluster(place, root, tasks_at_most, security)
            stack.callback(cluster.close)
        address = str(cluster.scheduler_address if cluster else place.address)
        tls.warn_if_open(address)
        try:
            client = stack.enter_context(_connected(address, security, place.reconnect_s))
        except OSError as error:
            finding = f"no scheduler answers ({error})"
            raise SimulationError("cluster", finding, "Start it, or correct its address.") from error
        if place.environment:
            from distributed.diagnostics.plugin import Environ

            client.register_plugin(Environ(place.environment))
        if cluster:
            start_workers(cluster, place, tasks_at_most)
        yield client


def _connected(address: str, security: Any, seconds: float) -> Any:
    from distributed import Client

    return Client(address, timeout=seconds, security=security, set_as_default=False)
