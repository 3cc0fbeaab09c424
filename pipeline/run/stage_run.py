"""Stages over all objects of a data set, as commands and DVC run them."""

import contextlib
import os
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

from pipeline.dataset.crew import Crew
from pipeline.dataset.parameters import PARAMETERS, read_parameters
from pipeline.dataset.records import read_records, read_table, write_records
from pipeline.dataset.run_id import RUN_ID, new_run_id
from pipeline.dataset.stages import STAGES
from pipeline.dataset.task import Failure
from pipeline.run.exclusive import exclusive
from pipeline.run.run_log import read_failures


@contextlib.contextmanager
def data_set_run(root: Path, what: str) -> Iterator[None]:
    """Hold the data set for a run that changes it; all that it starts is part of the same run.

    Parts of a run share a record, and try no failure twice.
    """
    os.environ.setdefault(RUN_ID, new_run_id())
    with exclusive(root, what):
        yield


def converge_stages(root: Path, names: Sequence[str]) -> int:
    """Converge stages over all objects; return 1 where one does not stand."""
    from pipeline.cluster.places import read_place
    from pipeline.run.converge import converge

    parameters = read_parameters(root / PARAMETERS)
    if "objects" in names:
        records = read_table(root, parameters.objects)
        write_records(root, records)
    else:
        records = read_records(root)
    place = read_place(root)
    stages = [STAGES[name] for name in names]

    def crew_for(jobs: int) -> AbstractContextManager[Crew]:
        from pipeline.cluster.cluster import crew

        return crew(place, root, jobs, stages)

    summaries = converge(
        stages,
        root,
        parameters,
        records.rows,
        crew_for,
        records.refused if "objects" in names else (),
    )
    return max(summary.exit_code(parameters.allow_failures) for summary in summaries)


def all_failures(root: Path) -> list[tuple[str, Failure]]:
    """Return the first failure of each object in the last runs, with its stage; paths from `root`."""
    first: dict[str, tuple[str, Failure]] = {}
    for stage in STAGES:
        for failure in read_failures(root, stage):
            error = failure.error.replace(f"{root}/", "")
            first.setdefault(failure.object_id, (stage, replace(failure, error=error)))
    return list(first.values())
