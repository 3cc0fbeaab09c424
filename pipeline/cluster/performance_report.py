"""Dask's performance report of a run, kept as ``runs/<run>-dask.html``; it opens without a network."""

import contextlib
import re
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from objectfolder.atomic import atomic_write
from pipeline.dataset.run_id import run_id

LEAST_S = 30.0  # a shorter run gets no report
MOST_REPORTS = 10  # of some megabytes each: every page carries its scripts with it
SUFFIX = "-dask.html"
ICON = re.compile(r"<link rel=\"shortcut icon\"[^>]*>")  # from a server of Dask's


@contextlib.contextmanager
def performance_report(client: Any, root: Path, least_s: float = LEAST_S) -> Iterator[None]:
    """Record what scheduler and workers do within the context: tasks, profiles, memory, bandwidth, logs.

    A report that cannot be made or written is a warning, for the run has its products all the same.

    Parameters
    ----------
    client
        A connected client.
    root
        Root of the data set.
    least_s
        Seconds of a run that is worth a report.
    """
    begin, wall = time.monotonic(), time.time()
    with _warning():
        client.get_task_stream(start=0, stop=0)  # lets the scheduler note tasks from now on
    yield
    if time.monotonic() - begin < least_s:
        return
    with _warning():
        page = client.sync(
            # Bokeh's scripts inside the page: by default it loads them from a server of Bokeh's.
            client.scheduler.performance_report,
            start=wall,
            last_count=0,
            code="",
            mode="inline",
        )
        with atomic_write(root / "runs" / f"{run_id()}{SUFFIX}") as file:
            file.write(ICON.sub("", page).encode())
    for path in excess(root):
        path.unlink(missing_ok=True)


def excess(root: Path) -> list[Path]:
    """Return the oldest reports, beyond `MOST_REPORTS`."""
    return sorted((root / "runs").glob(f"*{SUFFIX}"))[:-MOST_REPORTS]


@contextlib.contextmanager
def _warning() -> Iterator[None]:
    try:
        yield
    except Exception as error:
        # The scheduler may have ended, or lack Bokeh, which draws the page.
        warnings.warn(f"no performance report of Dask: {type(error).__name__}: {error}", stacklevel=3)
