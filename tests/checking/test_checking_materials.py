"""Materials that names contradict, and those they do not."""

import dataclasses

import pytest
from checked_rows import MATERIALS, entry

from pipeline.intake.check.row_rules import check_material as check


@pytest.mark.parametrize(
    ("object_id", "material", "found", "remedy"),
    [
        ("Threshold_Porcelain_Teapot_White", "plastic", "the name says porcelain", "Write ceramic"),
        ("WoodenTable_01", "steel", "the name says wooden", "Write wood"),
        ("School_Bell_Solid_Brass_38", "steel", "brass, which the table of materials does not", "Add a row"),
    ],
)
def test_contradictions(object_id, material, found, remedy):
    (finding,) = check(entry(object_id, material))
    assert finding.field == "material"
    assert found in finding.found
    assert remedy in finding.remedy


@pytest.mark.parametrize(
    ("object_id", "material"),
    [
        ("Threshold_Porcelain_Teapot_White", "ceramic"),
        ("Stainless_Wrench", "iron"),  # the two classes of one metal
        ("Magnifying_Glassassrt", "plastic"),
        ("Rubbermaid_Large_Drainer", "steel"),  # a maker
        ("Hollywood_Sign", "steel"),
    ],
)
def test_no_contradictions(object_id, material):
    assert list(check(entry(object_id, material))) == []


def test_a_material_of_ones_own_table_is_known_by_its_name():
    brass = dataclasses.replace(MATERIALS["steel"], name="brass")
    row = dataclasses.replace(entry("Solid_Brass_Bell", "steel"), materials={**MATERIALS, "brass": brass})
    (finding,) = check(row)
    assert finding.remedy.startswith("Write brass")
    assert list(check(dataclasses.replace(row, cells={**row.cells, "material": "brass"}))) == []


def test_an_unknown_material_is_for_the_table_to_refuse():
    assert list(check(entry("Wooden_Box", "wod"))) == []
