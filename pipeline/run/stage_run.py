"""The commands of the stages of ``dvc.yaml`` that make products: all at once, or one stage.

`make_products` is the first of them in every `dvc repro`. It waits for workers once and converges all
stages with no barrier between them. The single stages that follow in the same `dvc repro` ask
`pipeline.run.converged` and do nothing, so that DVC records the products.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from pipeline.cluster.places import read_place
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.job import Runner
from pipeline.dataset.parameters import PARAMETERS, read_parameters
from pipeline.dataset.records import read_records, read_table, write_records
from pipeline.dataset.stages import STAGES
from pipeline.run.converge import Summary, converge
from pipeline.run.converged import CONVERGED, run_id
from pipeline.run.exclusive import exclusive

NAMED = 8  # objects that a message names


@dataclass(frozen=True, kw_only=True)
class StageRun:
    """What a run did by stages, its exit status, and notes for people.

    The exit status is 1 where the stages behind cannot go on.
    """

    stages: tuple[Summary, ...]
    exit_code: int
    notes: tuple[str, ...]


def make_products(root: Path, place: str | None = None) -> StageRun:
    """Converge all stages at once at a place."""
    with exclusive(root, "all products"):
        (root / CONVERGED).unlink(missing_ok=True)
        run = _converge(root, list(STAGES), place)
        if run.exit_code == 0:
            (root / CONVERGED).write_text(run_id())
    return run


def make_stage(root: Path, name: str, place: str | None = None) -> StageRun:
    """Converge one stage of `STAGES` at a place."""
    with exclusive(root, f"stage {name}"):
        return _converge(root, [name], place)


def _converge(root: Path, names: Sequence[str], place: str | None) -> StageRun:
    """Converge stages over the selected objects."""
    parameters = read_parameters(root / PARAMETERS)
    where = read_place(root, place)
    if "objects" in names:
        records = read_table(root, parameters.objects)
        write_records(root, records)
    else:
        records = read_records(root)
    selected = records.selected(parameters.objects.only)
    others = records.listed - selected.listed
    notes = []
    if others:
        notes.append(
            f"{PARAMETERS}: objects.only selects {len(selected.listed)} of {len(records.listed)} objects; "
            "products of the others stay as they are"
        )
    stages = [STAGES[name] for name in names]

    def runner_for(jobs: int) -> AbstractContextManager[Runner]:
        from pipeline.cluster.cluster import runner

        return runner(where, root, jobs, stages)

    refused = [FailedObject.of("objects", one) for one in selected.refused if "objects" in names]
    summaries = converge(stages, root, parameters, selected.rows, runner_for, refused, others)
    if removed := sorted({name for summary in summaries for name in summary.removed} - records.listed):
        more = f" and {len(removed) - NAMED} more" if len(removed) > NAMED else ""
        table = parameters.objects.table
        notes.append(
            f"products removed of objects that {table} does not list: {', '.join(removed[:NAMED])}{more}"
        )
    exit_code = max(summary.exit_code(parameters.allow_failures) for summary in summaries)
    return StageRun(stages=tuple(summaries), exit_code=exit_code, notes=tuple(notes))
