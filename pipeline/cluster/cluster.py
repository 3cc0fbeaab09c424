"""Who runs the tasks of a place: a child process for a single one, else a Dask cluster."""

import contextlib
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from objectfolder.errors import SimulationError
from pipeline.cluster import tls
from pipeline.cluster.places import HERE, LOCAL, Place
from pipeline.cluster.pools import offers_here
from pipeline.cluster.starting import make_cluster, remove_keys, start_workers
from pipeline.dataset.job import Finished, Job, Runner, failed
from pipeline.dataset.project_files import DASHBOARD
from pipeline.dataset.task import Outcome
from pipeline.sandbox import scratch
from pipeline.sandbox.isolation import GLIBC, Child, ProcessKilled

FEW = 1  # jobs for which starting a cluster takes longer than it saves
MOST_KILLS_HERE = 2  # of a task's own process, after which it fails
# What the process of a worker must have before its Python starts.
SPAWNED: Mapping[str, str] = {
    # Units of learning run in the workers, and networks that are trained there take two fifths of their CPU
    # seconds for pages that are returned and asked for again.
    **GLIBC,
    "PYTHONSAFEPATH": "1",  # nothing in the current folder is a module
}
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
    **{f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in SPAWNED.items()},
}


@contextlib.contextmanager
def runner(place: Place, root: Path, jobs_at_most: int, stages: Iterable[Any] = ()) -> Iterator[Runner]:
    """Start or join what a place describes.

    Parameters
    ----------
    place
        Where to run.
    root
        The data folder, absolute.
    jobs_at_most
        Jobs that there will be: no more threads are started, and no cluster for a single one here.
    stages
        Stages (`pipeline.dataset.stage.Stage`) to be run: what workers from elsewhere must have the code of.

    Raises
    ------
    SimulationError
        No scheduler answers.
    """
    # Each is imported only where it is used: together they take as long as a small run.
    if jobs_at_most <= FEW and place.starts == LOCAL and not place.environment:
        with Child(root, place.child) as child:
            yield OneProcess(child)
        return
    from pipeline.cluster.dask_runner import DaskRunner
    from pipeline.cluster.environment_check import environment_of

    environment = None if place.starts in HERE else environment_of(stages)
    with (
        connect(place, root, jobs_at_most) as client,
        DaskRunner(client, root, place, environment) as running,
    ):
        if link := client.dashboard_link:
            print(f"Dask's dashboard: {link}", file=sys.stderr)
            (root / DASHBOARD).write_text(link)
        try:
            yield running
        finally:
            (root / DASHBOARD).unlink(missing_ok=True)


class OneProcess:
    """Runs jobs one after the other in a child process."""

    def __init__(self, child: Child) -> None:
        self._child = child
        self._jobs: list[Job] = []

    def submit(self, job: Job) -> None:
        """Accept a job."""
        self._jobs.append(job)

    def finished(self, on_workers: Callable[[int, int], None]) -> Iterator[Finished]:
        """Run the jobs and yield them as they end; one whose process is killed is tried once more."""
        while self._jobs:
            on_workers(1, 1)
            # No order is faster; with short ones first, it shows soon how fast this machine is.
            job = min(self._jobs, key=lambda job: job.seconds)
            self._jobs.remove(job)
            if missing := sorted(job.needs - set(offers_here())):
                remedy = "Install it, or run on a cluster that has it."
                yield Finished(job, failed(job, f"this machine does not offer {', '.join(missing)}", remedy))
                continue
            outcome, tries = self._run(job)
            yield Finished(job, outcome, "here", "here", tries)

    def _run(self, job: Job) -> tuple[Outcome, int]:
        for tries in range(1, MOST_KILLS_HERE + 1):
            try:
                return self._child.run(job.call, job.memory_bytes), tries
            except ProcessKilled as error:
                reason = str(error)
        remedy = "Out of memory, most likely: lower the settings of this stage."
        return failed(job, f"{reason}, {MOST_KILLS_HERE} times", remedy), MOST_KILLS_HERE


@contextlib.contextmanager
def connect(place: Place, root: Path, tasks_at_most: int) -> Iterator[Any]:
    """Start or join the cluster that a place describes; yield a connected client, and end what was started.

    The client's scheduler may have no worker yet, and workers may come and go. A worker that does not start,
    or ends, is started again.

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
    from distributed import Client

    with contextlib.ExitStack() as stack:
        scratch.sweep()
        scratch.sweep(root / scratch.KEYS)
        stack.enter_context(_environment_kept())
        own = dict(place.dask)
        if place.starts in HERE:
            own.setdefault("temporary-directory", stack.enter_context(scratch.Scratch("dask")))
        stack.enter_context(settings(own))
        security = tls.security(place, root)
        cluster = None
        if place.starts:
            cluster = make_cluster(place, root, tasks_at_most, security)
            stack.callback(remove_keys, cluster)
            stack.callback(cluster.close)
        address = str(cluster.scheduler_address if cluster else place.address)
        tls.warn_if_open(address)
        try:
            client = stack.enter_context(
                Client(address, timeout=place.reconnect_s, security=security, set_as_default=False)
            )
        except OSError as error:
            finding = f"no scheduler answers ({error})"
            raise SimulationError("cluster", finding, "Start it, or correct its address.") from error
        if place.environment:
            from distributed.diagnostics.plugin import Environ

            client.register_plugin(Environ(place.environment))
        if cluster:
            start_workers(cluster, place, tasks_at_most)
        yield client


@contextlib.contextmanager
def _environment_kept() -> Iterator[None]:
    """Take back what Dask's nannies set in the environment of this process for the workers they spawn.

    A later process of a caller would inherit it: with ``PYTHONSAFEPATH``, ``python -m`` runs other code.
    """
    before = {name: os.environ.get(name) for name in (*SPAWNED, "PYTHONHASHSEED")}
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def settings(own: Mapping[str, Any] | None = None) -> Any:
    """Return a context in which these settings hold; ``DASK_...`` variables and those of a place go first.

    `distributed` has to be imported before, or its own defaults would go with the context.
    """
    import dask

    variables = {key: f"DASK_{key.upper().replace('.', '__').replace('-', '_')}" for key in DEFAULTS}
    free = {key: value for key, value in DEFAULTS.items() if variables[key] not in os.environ}
    return dask.config.set({**free, **(own or {})})
