"""The commands of the stages of ``dvc.yaml`` that make products: all at once, or one stage.

`make_products` waits for workers once, converges all stages with no barrier between them, and writes the
manifest. The stages of ``dvc.yaml`` that own the folders of products hang on it; their command,
`record_stage`, finds the products made, so that DVC records them.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from pipeline.cluster.places import read_place
from pipeline.dataset.failures import FailedObject, read_failures
from pipeline.dataset.job import Runner
from pipeline.dataset.manifest import is_listed, read_products, write_manifest
from pipeline.dataset.parameters import PARAMETERS, read_parameters
from pipeline.dataset.records import read_records, read_table
from pipeline.dataset.selection import SELECTION, read_selection
from pipeline.dataset.stages import STAGES
from pipeline.dataset.verified import Verified, without_collector
from pipeline.run.converge import Summary, converge
from pipeline.run.damage import set_changed_aside, set_damaged_aside
from pipeline.run.exclusive import exclusive
from pipeline.run.partitions import require_whole
from pipeline.run.record import write_receipt
from pipeline.store.product_cache import ProductCache

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
        return _converge(root, list(STAGES), place)


def record_stage(root: Path, name: str, place: str | None = None) -> StageRun:
    """Find the products of a stage as the manifest lists them, else converge all stages; write a receipt."""
    with exclusive(root, f"record of stage {name}"):
        states = Verified(root)
        is_current = is_listed(root, STAGES[name], read_products(root), states)
        states.save()
        run = (
            StageRun(stages=(), exit_code=0, notes=()) if is_current else _converge(root, list(STAGES), place)
        )
        if run.exit_code == 0:
            write_receipt(root, name)
        return run


def make_stage(root: Path, name: str, place: str | None = None) -> StageRun:
    """Converge one stage of `STAGES` at a place."""
    with exclusive(root, f"stage {name}"):
        return _converge(root, [name], place)


def _converge(root: Path, names: Sequence[str], place: str | None) -> StageRun:
    """Converge stages over the selected objects, and bring the manifest to what they made."""
    require_whole(root)
    parameters = read_parameters(root / PARAMETERS)
    where = read_place(root, place)
    records = read_table(root, parameters.objects) if "objects" in names else read_records(root)
    selection = records.selected(read_selection(root))
    rest = records.listed - selection.listed
    notes = []
    if rest:
        notes.append(
            f"{SELECTION} selects {len(selection.listed)} of {len(records.listed)} objects; "
            "products of the others stay as they are"
        )
    stages = [STAGES[name] for name in names]

    def runner_for(jobs: int) -> AbstractContextManager[Runner]:
        from pipeline.cluster.cluster import runner

        return runner(where, root, jobs, stages)

    refusals = [FailedObject.of("objects", failure) for failure in selection.refused if "objects" in names]
    with without_collector():
        states, cache, entries = Verified(root), ProductCache(root), read_products(root)
        cache.add(entries.values())
        set_damaged_aside(root, entries, states)
    summaries = converge(stages, root, parameters, selection.rows, runner_for, refusals, rest, states)
    with without_collector():
        changes = set_changed_aside(root, entries, summaries, states)
        manifest = write_manifest(root, tuple(STAGES.values()), read_failures(root), states)
        cache.add(entry for entry in manifest if entries.get(entry.path) != entry)
        states.save()
    if extra_ids := sorted({name for summary in summaries for name in summary.removed} - records.listed):
        more = f" and {len(extra_ids) - NAMED} more" if len(extra_ids) > NAMED else ""
        table = parameters.objects.table
        notes.append(
            f"products removed of objects that {table} does not list: {', '.join(extra_ids[:NAMED])}{more}"
        )
    exit_code = max(summary.exit_code(parameters.allow_failures) for summary in summaries)
    if changes:
        notes.append("run again: products changed while this run went on")
        exit_code = 1
    return StageRun(stages=tuple(summaries), exit_code=exit_code, notes=tuple(notes))
