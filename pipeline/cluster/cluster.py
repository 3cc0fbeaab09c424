"""Who runs the tasks of a place: one child process for a single one, else a Dask cluster."""

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pipeline.cluster.places import HERE, LOCAL, SSH, Place, read_place
from pipeline.dataset.job import Runner

__all__ = ["Place", "read_place", "runner"]

FEW = 1  # jobs for which starting a cluster takes longer than it saves
STARTED_S = 120.0  # within which workers that need no queue have started


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
    if jobs_at_most <= FEW and place.starts == LOCAL:
        from pipeline.cluster.one_process import OneProcess

        with OneProcess(root, place.child) as process:
            yield process
        return
    from pipeline.cluster.dask_cluster import connect
    from pipeline.cluster.dask_runner import DaskRunner
    from pipeline.cluster.environment_check import environment_of
    from pipeline.cluster.workers import WaitLimits

    workers_s = place.workers_within_s
    if workers_s is None and place.starts in (*HERE, SSH):
        workers_s = STARTED_S
    environment = None if place.starts in HERE else environment_of(stages)
    limits = WaitLimits(workers_s, place.pools_within_s)
    with (
        connect(place, root, jobs_at_most) as client,
        DaskRunner(client, root, place.child, limits, environment, place.memory_gb) as running,
    ):
        yield running
