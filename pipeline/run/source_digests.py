"""``data/records.json`` and ``data/inputs.json``: the table of objects, and digests of meshes and textures.

With them ``dvc.yaml`` knows by object what changed, wherever the meshes lie.
"""

import itertools
import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.products.atomic import write_whole
from objectfolder.products.provenance import fingerprint
from pipeline.dataset.parameters import PARAMETERS, read_parameters
from pipeline.dataset.records import read_table, write_records
from pipeline.dataset.stage import Row, Stage, source_digest
from pipeline.dataset.stages import STAGES
from pipeline.dataset.verified import Verified, without_collector

INPUTS = Path("data/inputs.json")
BATCH = 64  # rows that a thread takes at once: handing one over takes longer than to see that it is known


@without_collector()
def write_inputs(root: Path) -> None:
    """Write what the table says now, for all of its objects.

    Raises
    ------
    InputError
        ``params.yaml`` or the table cannot be used.
    """
    objects = read_parameters(root / PARAMETERS).objects
    records = read_table(root, objects)
    states = Verified(root)
    stages = [stage for stage in STAGES.values() if stage.sources]
    with ThreadPoolExecutor() as pool:  # files are hashed outside Python's lock
        lists = pool.map(
            lambda rows: [[_digest(stage, row, states) for stage in stages] for row in rows],
            _batches(list(records.rows.values())),
        )
        digests = dict(zip(records.rows, itertools.chain.from_iterable(lists), strict=True))
    states.save()
    write_records(root, records)
    write_whole(root / INPUTS, json.dumps(digests, indent=1) + "\n")
    folder = root / objects.meshes
    meshes = (path for row in records.rows.values() for path in (row["mesh"], row["texture"]) if path)
    if folder.is_dir() and not all(path.is_relative_to(folder) for path in _absolute(meshes)):
        print(
            f"warning: {PARAMETERS}: objects.meshes is {objects.meshes}, and {objects.table} names files "
            "outside it. `dvc repro` does not see when they change. Set it to the folder of all meshes.",
            file=sys.stderr,
        )


def _batches(rows: Sequence[Row]) -> Iterator[Sequence[Row]]:
    return (rows[start : start + BATCH] for start in range(0, len(rows), BATCH))


def _absolute(paths: Iterable[Path]) -> Iterable[Path]:
    return (Path(os.path.abspath(path)) for path in paths)


def _digest(stage: Stage, row: Row, states: Verified) -> str:
    """Return a digest of all that a stage reads of an object beside its record, or why it cannot be read."""
    assert stage.sources is not None
    try:
        digests = {role: source_digest(path, states) for role, path in stage.sources(row).items()}
    except InputError as error:
        return error.finding
    return fingerprint({"inputs": digests, "record": {name: row[name] for name in stage.fields}})
