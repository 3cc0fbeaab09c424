"""Materials that names, notes and kinds of things contradict, and those they do not."""

import pytest
from checked_rows import MATERIALS, entry

from pipeline.intake.check.material import check

KNOWN = MATERIALS.keys()


@pytest.mark.parametrize(
    ("object_id", "material", "notes", "found", "remedy"),
    [
        ("Threshold_Porcelain_Teapot_White", "plastic", "", "the name says porcelain", "Write ceramic"),
        ("Thomas_Friends_Wooden_Railway", "polycarbonate", "", "the name says wooden", "Write wood"),
        ("WoodenTable_01", "steel", "", "the name says wooden", "Write wood"),
        ("Black_Decker_Stainless_Steel_Toaster", "plastic", "", "stainless, steel", "Write iron or steel"),
        ("Basket_Plastic_Teal", "wood", "", "the name says plastic", "Write plastic or polycarbonate"),
        ("Wine_Glass", "plastic", "", "the name says glass", "Write glass"),
        ("BUNNY_RACER", "polycarbonate", "painted wooden toy in truth", "the notes say wooden", "Write wood"),
        ("clamp", "iron", "made of ABS", "the notes say abs", "Write plastic or polycarbonate"),
        (
            "School_Bell_Solid_Brass_38",
            "steel",
            "",
            "brass, which the table of materials does not",
            "Add a row",
        ),
        ("bundt_pan", "ceramic", "cast aluminium", "aluminium, which", "Add a row"),
        ("Television_01", "steel", "", "a television is hardly of steel", "Likely glass, plastic"),
        ("Adjustable wrench", "glass", "", "a wrench is hardly of glass", "Likely iron"),
        ("Action_Figure", "steel", "", "a figure is hardly of steel", "Likely ceramic, glass, plastic"),
    ],
)
def test_contradictions(object_id, material, notes, found, remedy):
    (finding,) = check(entry(object_id, material, notes=notes), KNOWN)
    assert finding.field == "material"
    assert found in finding.found
    assert remedy in finding.remedy


@pytest.mark.parametrize(
    ("object_id", "material", "notes"),
    [
        ("Threshold_Porcelain_Teapot_White", "ceramic", ""),
        ("042_adjustable_wrench", "iron", "forged chromed steel"),  # the two classes of one metal
        ("Sterilite_Caddy", "polycarbonate", "polypropylene in truth"),  # the two classes of plastics
        ("031_spoon", "steel", "steel with a plastic handle"),
        ("050_medium_clamp", "plastic", "spring clamp of plastic, not iron as in the paper"),
        ("bundt_pan", "steel", "the table of materials has no aluminium"),
        ("Magnifying_Glassassrt", "plastic", ""),
        ("Magnifying_Glass", "plastic", ""),
        ("Iron_Man_Figure", "plastic", ""),
        ("Clothes_Iron", "plastic", ""),
        ("Rubbermaid_Large_Drainer", "steel", ""),  # a maker
        ("Top_Paw_Dog_Bowl_Ceramic", "ceramic", ""),
        ("Android_Figure_Chrome", "polycarbonate", ""),  # a colour
        ("Television_01", "steel", "a rare one of steel"),  # said so
        ("Toy_Television", "steel", ""),
        ("Hollywood_Sign", "steel", ""),
        ("Snap_On_Dust_Pan", "plastic", ""),
        ("Frying_Pan_Lid", "plastic", ""),
        ("Phone_Case", "wood", ""),
        ("mug", "glass", ""),
        ("Steel_Blue_Mug", "ceramic", ""),
    ],
)
def test_no_contradictions(object_id, material, notes):
    assert list(check(entry(object_id, material, notes=notes), KNOWN)) == []


def test_a_material_of_ones_own_table_is_known_by_its_name():
    known = {*KNOWN, "brass"}
    (found,) = check(entry("Solid_Brass_Bell", "steel"), known)
    assert found.remedy.startswith("Write brass")
    row = entry("Solid_Brass_Bell", "brass")
    assert list(check(row, known)) == []


def test_an_unknown_material_is_for_the_table_to_refuse():
    assert list(check(entry("Wooden_Box", "wod"), KNOWN)) == []
