"""Who runs the tasks of a place: one child process for a single one, else a Dask cluster."""

import contextlib
import functools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pipeline import machine_cluster, scratch, tls
from pipeline.crew import Crew
from pipeline.dask_crew import DaskCrew, Patience
from pipeline.dask_settings import settings
from pipeline.environment_check import environment_of
from pipeline.local_crew import LocalCrew
from pipeline.places import Place, read_place

__all__ = ["Place", "crew", "read_place"]

FEW = 1  # jobs for which a cluster would cost more than it gives
HERE = ("local", "cuda")  # kinds whose workers are this installation by construction
SOON_S = 120.0  # within which workers that are not queued for are there


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
        Jobs that there will be: no more workers are started, and no cluster for a single one here.
    stages
        Stages (`pipeline.stage.Stage`) to be run: what workers from elsewhere must have the code of.
    """
    if jobs_at_most <= FEW and place.kind == "local":
        with LocalCrew(root, place.child, place.memory_gb) as alone:
            yield alone
        return
    with contextlib.ExitStack() as stack:
        dask_files = scratch.Scratch("dask")
        stack.callback(dask_files.close)
        stack.enter_context(settings({"temporary-directory": str(dask_files.path), **place.dask}))
        certificates = _certificates(place, root)
        security = tls.security(certificates) if certificates else None
        address = stack.enter_context(_started(place, root, jobs_at_most, security, certificates))
        tls.warn_if_open(address, certificates)
        workers_s = place.workers_within_s
        if workers_s is None and place.kind in (*HERE, "ssh"):
            workers_s = SOON_S
        yield stack.enter_context(
            DaskCrew(
                functools.partial(_connected, address, security),
                root,
                place.child,
                None if place.kind in HERE else environment_of(stages),
                place.memory_gb,
                Patience(place.reconnect_s, workers_s, place.pools_within_s),
            )
        )


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
        from pipeline import ssh_cluster

        return ssh_cluster.start(place, root, jobs_at_most, security, certificates)
    if place.kind == "slurm":
        from pipeline import slurm_cluster

        return slurm_cluster.start(place, root, jobs_at_most, security)
    if place.kind == "kubernetes":
        from pipeline import kubernetes_cluster

        return kubernetes_cluster.start(place, jobs_at_most, security)
    return machine_cluster.start(place, jobs_at_most, security)


def _connected(address: str, security: Any, seconds: float) -> Any:
    from distributed import Client

    return Client(address, timeout=seconds, security=security, set_as_default=False)
