"""A scheduler in this process, with workers in jobs of Slurm."""

import contextlib
import logging
import math
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError, SimulationError
from pipeline.cluster.machine_cluster import listens_at
from pipeline.cluster.places import LOOPBACK, Place
from pipeline.cluster.pools import HOST, MEMORY, USABLE

JOB = "${SLURM_JOB_ID}"


@contextlib.contextmanager
def start(place: Place, root: Path, jobs_at_most: int, security: Any) -> Iterator[str]:
    """Start a scheduler here and ask Slurm for workers; yield the scheduler's address.

    The jobs wait in Slurm's queue; a worker works as soon as its job runs.

    Raises
    ------
    InputError
        The package that speaks to Slurm is missing.
    SimulationError
        Slurm refuses the jobs.
    """
    try:
        from dask_jobqueue import SLURMCluster
    except ImportError as error:
        remedy = "pip install 'objectfolder-factory[slurm]'"
        raise InputError("slurm", "the package dask-jobqueue is not installed", remedy) from error
    workers_of_job = place.workers or place.slurm.cores
    jobs = min(place.slurm.jobs, math.ceil(jobs_at_most / workers_of_job))
    with SLURMCluster(**options(place, root, security)) as cluster:
        _test(cluster.job_script())
        cluster.scale(jobs=jobs)
        yield cluster.scheduler_address


def _test(script: str) -> None:
    """Ask Slurm whether it would take a job."""
    with tempfile.NamedTemporaryFile("w", suffix=".sh") as file:
        file.write(script)
        file.flush()
        try:
            subprocess.run(["sbatch", "--test-only", file.name], check=True, capture_output=True, text=True)
        except FileNotFoundError as error:
            raise SimulationError("slurm", "there is no sbatch", "Run this on a login node.") from error
        except subprocess.CalledProcessError as error:
            raise SimulationError("slurm", error.stderr.strip(), "Correct slurm: in the place.") from error


def options(place: Place, root: Path, security: Any) -> dict[str, Any]:
    """Return what `dask_jobqueue.SLURMCluster` is made with."""
    slurm = place.slurm
    workers = place.workers or slurm.cores
    logs = Path(slurm.logs) if slurm.logs else root / ".objectfolder" / "slurm"
    usable_gb = USABLE * slurm.memory_gb if place.memory_gb is None else place.memory_gb
    prologue = [
        f"cd {shlex.quote(str(root))}",
        # A job's memory is its own, whatever else runs on its node.
        f'export {HOST}="$(hostname) ({JOB})"',
        f"export {MEMORY}={usable_gb:g}",
        *slurm.prologue,
    ]
    return {
        "cores": slurm.cores,
        "processes": workers,
        "memory": f"{slurm.memory_gb:g} GB",
        "job_cpu": slurm.cores,
        "walltime": slurm.walltime,
        "queue": slurm.partition,
        "account": slurm.account,
        "interface": slurm.interface,
        "job_name": "objectfolder",
        "job_extra_directives": list(slurm.directives),
        "job_script_prologue": prologue,
        "python": slurm.python or sys.executable,
        "worker_extra_args": ["--no-dashboard", "--dashboard-address", f"{LOOPBACK}:0"],
        "death_timeout": max(60, int(place.reconnect_s)),
        "local_directory": "${TMPDIR:-/tmp}",
        "log_directory": str(logs),
        "security": security,
        "protocol": "tls://" if security else "tcp://",
        "scheduler_options": {
            **({} if slurm.interface else {"host": listens_at(place)}),
            "port": place.port,
            "dashboard_address": os.environ.get("OBJECTFOLDER_DASHBOARD", place.dashboard),
        },
        "silence_logs": logging.ERROR,
    }
