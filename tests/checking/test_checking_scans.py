"""Real scans: the errors of a published annotation are found, and right rows are left alone."""

import csv
import json
from pathlib import Path

import pytest

from pipeline.cli import main

REPOSITORY = Path(__file__).parents[2]

# What the notes of the table say is wrong in the published list, by the field that is wrong.
WRONG = {
    "025_mug": "length_m",
    "042_adjustable_wrench": "length_m",
    "051_large_clamp": "material",
    "071_nine_hole_peg_test": "length_m",
    "Cole_Hardware_School_Bell_Solid_Brass_38": "material",
}
RIGHT = (
    "036_wood_block",
    "ACE_Coffee_Mug_Kristen_16_oz_cup",
    "Thomas_Friends_Wooden_Railway_Ascending_Track_Riser_Pack",
    "Now_Designs_Bowl_Akita_Black",
)


def papers_table(scans: Path, folder: Path, ids: tuple[str, ...]) -> Path:
    """A table of the published list's materials and lengths, for meshes that are there."""
    table = folder / "papers.csv"
    with (REPOSITORY / "data" / "objects.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["id"] in ids]
    with table.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        for row in rows:
            where = scans / row["id"]
            published = {"material": row["paper_material"], "length_m": row["paper_length_m"]}
            ours = {"notes": "", "shell_m": "", "metallic": "", "roughness": "", "accepted": ""}
            files = {"mesh": where / "model.obj", "texture": where / "texture.jpg"}
            writer.writerow(row | published | files | {key: ours[key] for key in ours.keys() & row.keys()})
    return table


@pytest.mark.release("pipeline.intake.check", "objectfolder.making.mesh")
def test_errors_of_the_published_list_are_found(shared_objects, tmp_path, capsys):
    table = papers_table(shared_objects, tmp_path, (*WRONG, *RIGHT))
    assert main(["check", str(table), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["measured"] == len(WRONG) + len(RIGHT)
    doubted = {
        (finding["object_id"], finding["field"])
        for finding in report["findings"]
        if finding["severity"] != "note"
    }
    for object_id, column in WRONG.items():
        # A published mass that iron cannot have is how a wrong material shows.
        assert {(object_id, column), (object_id, "mass_kg")} & doubted, object_id
    assert not {object_id for object_id, _ in doubted} & set(RIGHT)
    errors = [finding["object_id"] for finding in report["findings"] if finding["severity"] == "error"]
    assert set(errors) == {"071_nine_hole_peg_test"}
