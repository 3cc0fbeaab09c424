"""The workers of one of the factory's places do the units of a task."""

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
from dask.system import CPU_COUNT

from learning.workers import Workers
from pipeline.cluster.cluster import connect
from pipeline.cluster.places import LOCAL, Place, read_place

MOST_UNITS = 10_000  # that are done at a time, on as many workers as a place allows


class OnDask:
    """The workers of a Dask scheduler, which see this folder.

    Parameters
    ----------
    client
        A connected `distributed.Client`.
    """

    def __init__(self, client: Any) -> None:
        self._client, folder = client, os.getcwd()

        def enter() -> None:  # by value to workers, which may not find this module before
            os.chdir(folder)
            sys.path.insert(0, folder)
            torch.set_num_threads(1)

        client.register_worker_callbacks(enter)

    def share(self, value: Any) -> Any:
        """Return a future of the value, which each worker fetches once."""
        return self._client.scatter(value)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return a future of the result."""
        return self._client.submit(function, *arguments, pure=False)

    def gather(self, results: list[Any]) -> list[Any]:
        """Return the results of futures."""
        return list(self._client.gather(results))


@contextlib.contextmanager
def joined(named: str | None = None) -> Iterator[Workers]:
    """Start or join the workers of a place, and end what was started.

    Parameters
    ----------
    named
        As for `read_place`.
    """
    place = in_processes(read_place(Path.cwd(), named))
    with connect(place, Path.cwd(), MOST_UNITS) as client:
        yield OnDask(client)


def in_processes(place: Place) -> Place:
    """Return a place whose workers are processes of one thread, if they are local.

    The factory's tasks have processes of their own; units do not, and would wait for one another.
    """
    if place.starts != LOCAL:
        return place
    count = place.kwargs.get("n_workers", 1)
    threads = place.kwargs.get("threads_per_worker") or max(1, CPU_COUNT // count)
    return place.model_copy(
        update={"kwargs": {**place.kwargs, "n_workers": count * threads, "threads_per_worker": 1}}
    )
