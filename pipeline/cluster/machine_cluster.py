"""A scheduler in this process, with workers on this machine: one a core, or one a GPU."""

import contextlib
import logging
import os
import subprocess
from collections.abc import Iterator, Mapping
from typing import Any

from objectfolder.errors import InputError
from pipeline.cluster.places import LOOPBACK, Place

VISIBLE = "CUDA_VISIBLE_DEVICES"
LIST_DEVICES = ("nvidia-smi", "--query-gpu=uuid", "--format=csv,noheader")


@contextlib.contextmanager
def start(place: Place, jobs_at_most: int, security: Any) -> Iterator[str]:
    """Start scheduler and workers; yield the scheduler's address."""
    from dask.system import CPU_COUNT

    if place.kind == "cuda":
        workers = [_worker(place, security, 1, {VISIBLE: device}) for device in devices(place)]
        workers = workers[:jobs_at_most]
    else:
        workers = [_worker(place, security, min(place.workers or CPU_COUNT, jobs_at_most), {})]
    with spec_cluster(place, security, dict(enumerate(workers))) as cluster:
        yield cluster.scheduler_address


def spec_cluster(place: Place, security: Any, workers: Mapping[Any, Mapping[str, Any]]) -> Any:
    """Return a cluster with its scheduler in this process, as the place says, and workers as specified."""
    from distributed import Scheduler, SpecCluster

    scheduler = {
        "host": listens_at(place),
        "port": place.port,
        "protocol": "tls" if security else "tcp",
        "security": security,
        "dashboard_address": os.environ.get("OBJECTFOLDER_DASHBOARD", place.dashboard),
    }
    return SpecCluster(
        scheduler={"cls": Scheduler, "options": scheduler},
        workers=dict(workers),
        security=security,
        silence_logs=logging.ERROR,
    )


def listens_at(place: Place) -> str:
    """Return the address at which a scheduler of this process listens."""
    from distributed.utils import get_ip

    return place.listen or str(get_ip())


def devices(place: Place) -> list[str]:
    """Return the GPUs to use: those that the place, else the environment, else the driver names.

    Raises
    ------
    InputError
        There is none.
    """
    if place.cuda.devices is not None:
        found = place.cuda.devices
    elif VISIBLE in os.environ:
        found = [name.strip() for name in os.environ[VISIBLE].split(",") if name.strip() not in ("", "-1")]
    else:
        try:
            answer = subprocess.run(LIST_DEVICES, capture_output=True, text=True, check=True)
            found = answer.stdout.split()
        except (OSError, subprocess.CalledProcessError) as error:
            raise InputError(
                "cuda", f"nvidia-smi names no GPU ({error})", "Name cuda.devices in the place."
            ) from error
    if not found:
        raise InputError("cuda", "no GPU is visible", f"Name cuda.devices in the place, or set {VISIBLE}.")
    return found


def _worker(place: Place, security: Any, threads: int, environment: Mapping[str, str]) -> dict[str, Any]:
    from distributed import Nanny

    options = {
        "nthreads": threads,
        "memory_limit": 0,  # the memory is the children's, which the nanny does not see
        "host": listens_at(place),
        "protocol": "tls" if security else "tcp",
        "security": security,
        "dashboard": False,
        "dashboard_address": f"{LOOPBACK}:0",
        "silence_logs": logging.ERROR,
        "env": dict(environment),
    }
    return {"cls": Nanny, "options": options}
