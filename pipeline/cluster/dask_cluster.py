"""Starting, or joining, the Dask cluster that a place describes."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from objectfolder.errors import SimulationError
from pipeline.cluster import machine_cluster, tls
from pipeline.cluster.dask_settings import settings
from pipeline.cluster.places import Place
from pipeline.sandbox import scratch


@contextlib.contextmanager
def connect(place: Place, root: Path, tasks_at_most: int) -> Iterator[Any]:
    """Start or join the cluster that a place describes; yield a connected client, and end what was started.

    The client's scheduler may have no worker yet. A started worker has a thread for each core that its tasks
    may use, and a memory limit that is its part of the host's memory.

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
    SimulationError
        The scheduler does not answer.
    """
    with contextlib.ExitStack() as stack:
        scratch.sweep()
        dask_files = scratch.Scratch("dask")
        stack.callback(dask_files.close)
        stack.enter_context(settings({"temporary-directory": str(dask_files.path), **place.dask}))
        certificates = _certificates(place, root)
        security = tls.security(certificates) if certificates else None
        address = stack.enter_context(_started(place, root, tasks_at_most, security, certificates))
        tls.warn_if_open(address, certificates)
        try:
            client = stack.enter_context(_connected(address, security, place.reconnect_s))
        except OSError as error:
            finding = f"no scheduler answers ({error})"
            raise SimulationError("cluster", finding, "Start it, or correct its address.") from error
        yield client


def _certificates(place: Place, root: Path) -> Path | None:
    """Return the folder of the certificates, made at need by who starts the scheduler; None for no TLS."""
    folder = tls.folder_of(root, place.tls)
    if folder is not None and place.kind not in ("address", "kubernetes"):
        tls.make(folder)
    return folder


def _started(
    place: Place, root: Path, jobs_at_most: int, security: Any, certificates: Path | None
) -> contextlib.AbstractContextManager[str]:
    if place.kind == "address":
        assert place.address is not None
        return contextlib.nullcontext(place.address)
    if place.kind == "ssh":
        from pipeline.cluster import ssh_cluster

        return ssh_cluster.start(place, root, jobs_at_most, security, certificates)
    if place.kind == "slurm":
        from pipeline.cluster import slurm_cluster

        return slurm_cluster.start(place, root, jobs_at_most, security)
    if place.kind == "kubernetes":
        from pipeline.cluster import kubernetes_cluster

        return kubernetes_cluster.start(place, jobs_at_most, security)
    return machine_cluster.start(place, jobs_at_most, security)


def _connected(address: str, security: Any, seconds: float) -> Any:
    from distributed import Client

    return Client(address, timeout=seconds, security=security, set_as_default=False)
