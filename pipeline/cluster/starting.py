"""Making the cluster class that a place names, and keeping as many workers as it should have.

``cluster.scale`` and ``cluster.adapt`` say how many workers there are. Neither starts one again that did
not start: it stays in ``cluster.workers``, and Dask compares numbers alone. ``scale`` to fewer and back would
drop any worker that has not connected, hence also a job that waits in a queue. So those that failed are
taken out of ``cluster.workers`` by name, and Dask starts what is missing (`_start_again`).
"""

import asyncio
import importlib
import inspect
import logging
import math
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError, ObjectFolderError, SimulationError
from pipeline.cluster import tls
from pipeline.cluster.places import HERE, LOCAL, SSH, Place
from pipeline.cluster.pools import MEMORY
from pipeline.dataset.validation import did_you_mean
from pipeline.sandbox import scratch

EXTRAS = {"dask_jobqueue": "slurm", "dask_kubernetes": "kubernetes", "asyncssh": "ssh"}
LOOK_S = 10.0  # between looks for workers that have to be started again
PRIVATE_DASHBOARD = "127.0.0.1:0"
IDLE = "1 hour"  # after which a scheduler on another machine ends, if its driver has ended
GONE_S = 60  # after which a worker of it ends, too
HERE_OPTIONS = {"memory_limit": 0, "dashboard_address": PRIVATE_DASHBOARD, "silence_logs": logging.CRITICAL}
WORKER_OPTIONS = ["--memory-limit", "0", "--no-dashboard"]  # the memory is that of the tasks' own processes


def make_cluster(place: Place, root: Path, tasks_at_most: int, security: Any) -> Any:
    """Return the cluster of a place, without workers where its class can start them later.

    Raises
    ------
    InputError
        A class that is not installed, does not exist or is no cluster of Dask, or an argument that it does
        not take.
    SimulationError
        It does not start.
    """
    kind = _cluster_class(place)
    check_arguments(kind, place)
    arguments = dict(place.kwargs)
    try:
        if place.starts == LOCAL:
            arguments = _local(arguments, tasks_at_most)
        if place.starts in HERE:
            return kind(*place.args, **HERE_OPTIONS | {"security": security} | arguments)
        if place.starts == SSH:
            return _ssh(kind, arguments, security)
        if place.module == "dask_jobqueue":
            folder = root / scratch.KEYS
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            keys = scratch.Scratch("keys", folder)
            cluster = _accepted(kind(*place.args, **_batch(arguments, place, root, security, keys.name)))
            cluster.keys = keys  # removed by `remove_keys`; by the next run if this process is killed
            return cluster
        return kind(*place.args, **arguments)
    except ObjectFolderError:
        raise
    except Exception as error:  # classes of other projects raise errors of any type
        raise SimulationError(place.starts, f"does not start ({error})", "See docs/cluster.md.") from error


def remove_keys(cluster: Any) -> None:
    """Remove the keys of a cluster of batch jobs that has closed: each file, and then their folder."""
    for file in (getattr(cluster, f"_job_{kind}", None) for kind in ("cert", "key", "ca_file")):
        if file is not None:
            file.close()
    if keys := getattr(cluster, "keys", None):
        keys.cleanup()


def start_workers(cluster: Any, place: Place, tasks_at_most: int) -> None:
    """Let a cluster start the workers that the place asks for, again where one does not start or ends."""
    from distributed import SpecCluster
    from tornado.ioloop import PeriodicCallback

    useful = math.ceil(tasks_at_most / (place.capacity()[1] or 1))
    if place.adapt is not None:
        most = min(place.adapt.maximum, useful)
        cluster.adapt(minimum=min(place.adapt.minimum, most), maximum=most)
    elif place.starts == LOCAL or place.module == "dask_jobqueue":
        cluster.scale(min(place.kwargs.get("n_workers", 1), useful))
    if isinstance(cluster, SpecCluster):
        looks = PeriodicCallback(lambda: _start_again(cluster), LOOK_S * 1e3)
        cluster.periodic_callbacks["start again"] = looks  # stopped with the others
        cluster.loop.add_callback(looks.start)


async def _start_again(cluster: Any) -> None:
    """Forget workers that did not start or have ended, so that the cluster starts them again."""
    from distributed.core import Status

    for name, worker in list(cluster.workers.items()):
        if name in cluster.worker_spec and worker.status in (Status.created, Status.failed, Status.closed):
            print(f"worker {name} did not start or has ended; started again", file=sys.stderr)
            await worker.close()
            cluster.workers.pop(name, None)
    for name, job in (await _ended_jobs(cluster)).items():
        print(f"job {job} of worker {name} ended before it came; started again", file=sys.stderr)
        cluster.workers.pop(name, None)
    try:
        await cluster
    except Exception as error:  # of SSH, of a batch system, of a process
        print(f"a worker does not start: {error}; tried again", file=sys.stderr)


async def _ended_jobs(cluster: Any) -> dict[Any, str]:
    """Return the jobs of Slurm that ended before their worker connected, by its name: Dask waits for them."""
    if getattr(getattr(cluster, "job_cls", None), "submit_command", "") != "sbatch":
        return {}
    present = {worker["name"] for worker in cluster.scheduler_info["workers"].values()}
    jobs = {name: worker.job_id for name, worker in cluster.workers.items() if name not in present}
    if not jobs:
        return {}
    command = ["squeue", "--noheader", "--format=%i", f"--user={os.getuid()}"]
    process = await asyncio.create_subprocess_exec(
        *command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    queue = (await process.communicate())[0].decode().split()
    if process.returncode:  # Slurm does not answer, and says nothing of jobs
        return {}
    return {name: job for name, job in jobs.items() if job and job not in queue and name in cluster.workers}


def _cluster_class(place: Place) -> Callable[..., Any]:
    """Return the class of a place; raise InputError for anything but a cluster of Dask."""
    from distributed.deploy import Cluster

    target = _imported(place.module, place.class_name)
    # `SSHCluster` is a function that returns one.
    if place.starts != SSH and not (inspect.isclass(target) and issubclass(target, Cluster)):
        remedy = "Name a class of clusters, as distributed.LocalCluster."
        raise InputError(place.starts, "is no cluster of Dask", remedy)
    return target


def _imported(module: str, name: str) -> Callable[..., Any]:
    try:
        target: Callable[..., Any] = getattr(importlib.import_module(module), name)
    except ImportError as error:
        package = (error.name or module).partition(".")[0]
        extra = EXTRAS.get(package)
        requirement = f"'objectfolder-factory[{extra}]'" if extra else package.replace("_", "-")
        finding = f"the package {package} is not installed"
        raise InputError(f"{module}.{name}", finding, f"pip install {requirement}") from error
    except AttributeError as error:
        names = dir(importlib.import_module(module))
        remedy = did_you_mean(name, names, "Correct class and module of the place.")
        raise InputError(f"{module}.{name}", "there is no such class", remedy) from error
    return target


def check_arguments(kind: Any, place: Place) -> None:
    """Refuse arguments that a class does not take: some classes ignore unknown arguments.

    Raises
    ------
    InputError
        It does not take one.
    """
    from distributed import Nanny, SpecCluster, Worker

    classes = (kind, getattr(kind, "job_cls", kind), SpecCluster, Nanny, Worker)
    takers = {taker for entry in classes for taker in (entry, *getattr(entry, "__mro__", ()))}
    names = {name for taker in takers for name in inspect.signature(taker).parameters}
    for name in place.kwargs:
        if name not in names:
            remedy = did_you_mean(name, names, f"See the documentation of {place.starts}.")
            raise InputError(place.starts, f"unknown argument kwargs.{name}", remedy)


def _local(arguments: dict[str, Any], tasks_at_most: int) -> dict[str, Any]:
    """Return the arguments of a `LocalCluster`: one worker with a thread for each core."""
    from dask.system import CPU_COUNT

    workers = arguments.pop("n_workers", 1)
    threads = arguments.pop("threads_per_worker", None) or math.ceil(CPU_COUNT / workers)
    return {"n_workers": 0, "threads_per_worker": min(threads, tasks_at_most), "processes": True} | arguments


def _batch(arguments: dict[str, Any], place: Place, root: Path, security: Any, keys: str) -> dict[str, Any]:
    """Return the arguments of a class of dask-jobqueue: one worker in a job."""
    arguments.pop("n_workers", None)
    own = root / ".objectfolder"
    (own / "jobs").mkdir(parents=True, exist_ok=True)
    prologue = [f"cd {shlex.quote(str(root))}"]
    if memory_bytes := place.capacity()[2]:
        prologue.append(f"export {MEMORY}={memory_bytes / 1e9:g}")
    return {
        "processes": 1,
        "job_name": "objectfolder",
        "local_directory": "${TMPDIR:-/tmp}",
        "log_directory": str(own / "jobs"),
        "shared_temp_directory": keys,
        "security": security,
        "silence_logs": logging.CRITICAL,
        **arguments,
        "scheduler_options": {
            "dashboard_address": PRIVATE_DASHBOARD,
            **arguments.get("scheduler_options", {}),
        },
        "job_script_prologue": [*prologue, *arguments.get("job_script_prologue", [])],
        "worker_extra_args": [*WORKER_OPTIONS, *arguments.get("worker_extra_args", [])],
    }


def _accepted(cluster: Any) -> Any:
    """Return a cluster of batch jobs; Slurm is asked first whether it would take one."""
    if cluster.job_cls.submit_command != "sbatch":
        return cluster
    with tempfile.NamedTemporaryFile("w", suffix=".sh") as file:
        file.write(cluster.job_script())
        file.flush()
        try:
            subprocess.run(["sbatch", "--test-only", file.name], check=True, capture_output=True, text=True)
        except (FileNotFoundError, subprocess.CalledProcessError) as error:
            cluster.close()
            finding = str(getattr(error, "stderr", "there is no sbatch")).strip()
            remedy = "Run this on a login node, and correct kwargs of the place."
            raise SimulationError("slurm", finding, remedy) from error
    return cluster


def _ssh(kind: Any, arguments: dict[str, Any], security: Any) -> Any:
    """Return an `SSHCluster` whose scheduler runs and whose workers are yet to be started.

    The class itself starts all at once, and not at all where one machine cannot be reached.
    """
    from distributed.deploy.ssh import Worker

    _imported("asyncssh", "connect")
    security_settings = {"protocol": "tls", "security": tls.as_mapping(security)} if security else {}
    hosts = arguments.pop("hosts")
    scheduler = {"dashboard_address": PRIVATE_DASHBOARD, "idle_timeout": IDLE, **security_settings}
    scheduler |= arguments.pop("scheduler_options", {})
    worker = {"memory_limit": 0, "dashboard": False, "death_timeout": GONE_S, **security_settings}
    worker |= arguments.pop("worker_options", {})
    cluster = kind(hosts[:1], scheduler_options=scheduler, security=security, **arguments)
    options = {
        "connect_options": arguments.get("connect_options", {}),
        "kwargs": worker,
        "worker_class": arguments.get("worker_class", "distributed.Nanny"),
        "remote_python": arguments.get("remote_python"),
    }
    cluster.worker_spec = {
        f"{host}-{index}": {"cls": Worker, "options": {"address": host, **options}}
        for index, host in enumerate(hosts[1:])
    }
    return cluster
