"""The table of the paper's hundred objects."""

import csv
from collections import Counter
from pathlib import Path

import pytest

from pipeline.intake.sources.registry import source_and_name

TABLE = Path(__file__).parents[2] / "data" / "objects.csv"


@pytest.fixture(scope="module")
def rows() -> list[dict[str, str]]:
    with TABLE.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_all_hundred_are_there_in_the_papers_order(rows):
    assert [int(row["paper_index"]) for row in rows] == list(range(1, 101))
    assert Counter(row["source_id"].partition(":")[0] for row in rows) == {
        "polyhaven": 20,
        "ycb": 28,
        "gso": 52,
    }
    assert all(float(row["paper_length_m"]) > 0 and row["paper_material"] for row in rows)


def test_every_row_is_under_its_sources_name_and_terms(rows):
    for row in rows:
        source, name = source_and_name(row["source_id"])
        source.check_name(name)
        assert name == row["id"]
        assert (row["licence"], row["source"]) == (source.licence, source.title)
        assert row["source_url"] == source.object_page(name)
        assert row["attribution"]


def test_what_differs_from_the_paper_is_explained(rows):
    for row in rows:
        if row["material"] != row["paper_material"]:
            assert f"not {row['paper_material']} as in the paper" in row["notes"], row["id"]
        if row["shell_m"] or row["wall_m"] or row["accepted"]:
            assert row["notes"], row["id"]
        if row["metallic"]:
            assert "metallic" in row["notes"], row["id"]
        assert bool(row["mass_kg"]) == bool(row["mass_source"])
    differing = {row["id"] for row in rows if row["material"] != row["paper_material"]}
    assert {"Television_01", "050_medium_clamp", "051_large_clamp", "052_extra_large_clamp"} <= differing


def test_lengths_are_those_of_the_meshes(rows):
    """Every source is in metres; the paper's lengths of YCB are nominal."""
    assert {row["length_m"] for row in rows} == {"as in file"}
    pegs = next(row for row in rows if row["id"] == "071_nine_hole_peg_test")
    assert (pegs["paper_length_m"], "mesh 0.19111 m" in pegs["notes"]) == ("1.2", True)
