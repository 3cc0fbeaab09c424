"""Who runs the tasks of a place: one child process for a single one, else a Dask cluster."""

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pipeline.cluster.places import Place, read_place
from pipeline.dataset.crew import Crew

__all__ = ["Place", "crew", "read_place"]

FEW = 1  # jobs for which a cluster would cost more than it gives


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
        Stages (`pipeline.dataset.stage.Stage`) to be run: what workers from elsewhere must have the code of.
    """
    # Each is imported only where it is used: together they take as long as a small run.
    if jobs_at_most <= FEW and place.kind == "local":
        from pipeline.cluster.local_crew import LocalCrew

        with LocalCrew(root, place.child, place.memory_gb) as alone:
            yield alone
        return
    from pipeline.cluster import dask_cluster

    with dask_cluster.start(place, root, jobs_at_most, stages) as running:
        yield running
