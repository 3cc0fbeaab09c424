"""Looks against the material and what the row says."""

import pytest
from checked_rows import entry

from pipeline.intake.check.finding import NOTE, WARNING
from pipeline.intake.check.looks import check


@pytest.mark.parametrize(
    ("material", "cells", "found"),
    [
        ("steel", {"metallic": "0"}, "0 for steel, which is a metal"),
        ("plastic", {"metallic": "1"}, "1 for plastic, which is no metal"),
        ("plastic", {"roughness": "0.1", "name": "Matte black case"}, "0.1, where the row says matte"),
        ("steel", {"roughness": "0.9", "notes": "polished"}, "0.9, where the row says polished"),
    ],
)
def test_looks_that_contradict(material, cells, found):
    (finding,) = check(entry("thing", material, **cells))
    assert finding.severity == WARNING
    assert finding.found == found


def test_paint_on_metal_is_worth_a_note():
    (finding,) = check(entry("mug", "steel", notes="enamelled steel"))
    assert (finding.severity, finding.field) == (NOTE, "metallic")


@pytest.mark.parametrize(
    ("material", "cells"),
    [
        ("steel", {}),
        ("steel", {"metallic": "1", "roughness": "0.2"}),
        ("steel", {"metallic": "0", "notes": "enamelled steel: the surface is glass"}),
        ("plastic", {"metallic": "1", "name": "Android Figure Chrome"}),
        ("ceramic", {"metallic": "0", "roughness": "0.3"}),
        ("plastic", {"roughness": "0.1", "notes": "not matte"}),
        ("plastic", {"roughness": "shiny"}),  # the table itself refuses it
        ("unobtainium", {"metallic": "0"}),
    ],
)
def test_looks_that_do_not(material, cells):
    assert list(check(entry("thing", material, **cells))) == []
