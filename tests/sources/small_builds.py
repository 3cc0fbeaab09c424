"""Fetched objects made into Object Files by the pipeline's own stages, at a size of seconds."""

import csv
import io
import shutil
from collections.abc import Mapping
from pathlib import Path

import yaml

from objectfolder.object_file import ObjectFile
from pipeline.cluster.cluster import crew
from pipeline.cluster.places import Place
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.records import read_table
from pipeline.dataset.stages import OBJECT_FILES, STAGES
from pipeline.intake.sources.fetching import Fetched
from pipeline.intake.sources.proposed_row import proposed_rows
from pipeline.run.converge import converge
from tests.conftest import REPOSITORY


def built(objects: Mapping[str, str], fetched: Mapping[str, Fetched], root: Path) -> dict[str, ObjectFile]:
    """Make a data set of objects that lie in ``<root>/data/fetched``.

    Parameters
    ----------
    objects
        Material of each, by source id.
    fetched
        Of each.

    Returns
    -------
    dict
        By source id.
    """
    rows = list(csv.DictReader(io.StringIO(proposed_rows([fetched[one] for one in objects], root / "data"))))
    with (root / "data" / "objects.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows({**row, "material": objects[row["source_id"]]} for row in rows)
    shutil.copy(REPOSITORY / "data" / "materials.csv", root / "data")
    _write_parameters(root / "params.yaml")
    parameters = read_parameters(root / "params.yaml")
    records = read_table(root, parameters.objects)
    assert records.refused == ()
    summaries = converge(
        list(STAGES.values()), root, parameters, records.rows, lambda jobs: crew(Place(workers=1), root, jobs)
    )
    assert [failure for summary in summaries for failure in summary.failures] == []
    return {row["source_id"]: ObjectFile.load(OBJECT_FILES.path(root, row["id"])) for row in rows}


def _write_parameters(path: Path) -> None:
    said = yaml.safe_load((REPOSITORY / "params.yaml").read_text(encoding="utf-8"))
    said["objects"]["table"] = "data/objects.csv"
    size = said["sizes"]["default"]
    size["vision"].update(
        resolution=16,
        training_views=4,
        training_samples=4,
        held_out_views=2,
        held_out_samples=8,
        passes=False,
    )
    size["audio"].update(
        max_frequency_hz=100.0, accuracy_cents=1200.0, training_points=120, held_out_points=20
    )
    size["touch"].update(touches=1, held_out_touches=2)
    size["encode"]["visionnet"].update(steps=20)
    path.write_text(yaml.safe_dump(said), encoding="utf-8")
