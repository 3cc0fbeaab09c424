"""The commands of the stages of ``dvc.yaml``: all products at once, one stage, the starter set, the failures.

`make_products` is the first of them in every `dvc repro`. It waits for workers once and converges all
stages with no barrier between them. The single stages that follow in the same `dvc repro` ask
`pipeline.run.converged` and do nothing, so that DVC records the products.
"""

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

from objectfolder.errors import InputError
from pipeline.run.converged import forget_converged, note_converged
from pipeline.run.exclusive import running

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from pipeline.dataset.job import Runner
    from pipeline.dataset.records import Records
    from pipeline.run.converge import Summary

STARTER = "data/starter"
NAMED = 8  # objects that a message names


def make_products(root: Path) -> int:
    """Converge all stages at once; return 1 where the stages behind cannot go on."""
    from pipeline.dataset.stages import STAGES

    with running(root, "all products"):
        forget_converged(root)
        code = _converge(root, list(STAGES))
        if code == 0:
            note_converged(root)
    return code


def make_stage(root: Path, name: str) -> int:
    """Converge one stage; return 1 where those behind it cannot go on.

    Raises
    ------
    InputError
        There is no such stage.
    """
    from pipeline.dataset.stages import STAGES

    if name not in STAGES:
        near = get_close_matches(name, STAGES, n=1)
        meant = f"Did you mean {near[0]}? " if near else ""
        raise InputError(name, "no such stage", f"{meant}Stages are {', '.join(STAGES)}.")
    with running(root, f"stage {name}"):
        return _converge(root, [name])


def make_starter_set(root: Path) -> int:
    """Write the meshes and textures of the starter set."""
    from objectfolder.mesh.starter.write import write_starter_set

    with running(root, "stage starter"):
        write_starter_set(root / STARTER)
    return 0


def show_failures(root: Path) -> int:
    """Print the objects of the data set that failed; return 1 if there are any."""
    from pipeline.dataset.failures import failure_table, read_failures
    from pipeline.dataset.task import Failure

    found = [Failure(one.object, f"{one.stage}: {one.error}", one.remedy) for one in read_failures(root)]
    if found:
        print(failure_table(found))
        print("`dvc repro` tries them again.")
    return 1 if found else 0


def _converge(root: Path, names: Sequence[str]) -> int:
    """Converge stages over the selected objects."""
    from pipeline.cluster.places import read_place
    from pipeline.dataset.parameters import PARAMETERS, read_parameters
    from pipeline.dataset.records import read_records, read_table, write_records
    from pipeline.dataset.stages import STAGES
    from pipeline.run.converge import converge

    parameters = read_parameters(root / PARAMETERS)
    place = read_place(root)
    if "objects" in names:
        records = read_table(root, parameters.objects)
        write_records(root, records)
    else:
        records = read_records(root)
    selected = records.selected(parameters.objects.only)
    others = records.listed - selected.listed
    if others:
        print(
            f"{PARAMETERS}: objects.only selects {len(selected.listed)} of {len(records.listed)} objects; "
            "products of the others stay as they are"
        )
    stages = [STAGES[name] for name in names]

    def runner_for(jobs: int) -> "AbstractContextManager[Runner]":
        from pipeline.cluster.cluster import runner

        return runner(place, root, jobs, stages)

    refused = selected.refused if "objects" in names else ()
    summaries = converge(stages, root, parameters, selected.rows, runner_for, refused, others)
    _say_what_was_removed(summaries, records, parameters.objects.table)
    return max(summary.exit_code(parameters.allow_failures) for summary in summaries)


def _say_what_was_removed(summaries: "Sequence[Summary]", records: "Records", table: str) -> None:
    removed = sorted({name for summary in summaries for name in summary.removed} - records.listed)
    if removed:
        more = f" and {len(removed) - NAMED} more" if len(removed) > NAMED else ""
        print(f"products removed of objects that {table} does not list: {', '.join(removed[:NAMED])}{more}")
