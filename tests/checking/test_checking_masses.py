"""Density times volume against what is published, and against what is held."""

import pytest
from checked_rows import entry, shape

from pipeline.intake.check.entry import ERROR, WARNING
from pipeline.intake.check.mesh_rules import check_mass as check
from pipeline.intake.check.mesh_rules import mass_as_made

BLOCK = (0.2, 0.1, 0.1)  # 2 litres: 1.5 kg of wood, 15.7 kg of steel


@pytest.mark.parametrize("mass", ["1.5", "0.8", "2.9"])
def test_masses_that_agree_within_what_scans_and_woods_differ_by(mass):
    assert list(check(entry(of=shape(BLOCK), mass_kg=mass))) == []


def test_too_heavy_is_hollow_or_of_something_else():
    (finding,) = check(entry(material="iron", of=shape(BLOCK), mass_kg="2.8"))
    assert (finding.severity, finding.field) == (WARNING, "mass_kg")
    assert "16 kg, 5.7 times the published 2.8 kg" in finding.found
    assert "iron has 8000 kg/m3, 1400 would fit, near plastic and polycarbonate" in finding.found
    assert "hollow" in finding.remedy


def test_too_light_misses_parts():
    (finding,) = check(entry(of=shape(BLOCK), mass_kg="5"))
    assert finding.severity == WARNING
    assert "0.3 times" in finding.found
    assert "missing" in finding.remedy


def test_an_absurd_mass_names_the_length_that_explains_it():
    # 1.2 m stated for a board of 0.19 m: the mass is 6.28^3 times too large.
    large = tuple(side * 1.2 / 0.191 for side in (0.191, 0.167, 0.041))
    (finding,) = check(entry(of=shape(large), mass_kg="0.98"))
    assert finding.severity == ERROR
    assert "a length of 0.191 m instead of 1.2 m would explain it" in finding.remedy


def test_a_shell_weighs_what_its_wall_weighs():
    can = {"of": shape((0.14, 0.1, 0.1), area=0.076), "mass_kg": "0.12"}
    (finding,) = check(entry(material="steel", **can))
    assert "published 120 g" in finding.found
    assert list(check(entry(material="steel", shell_m="0.0002", **can))) == []
    assert mass_as_made(entry(material="steel", shell_m="0.0002", **can)) == pytest.approx(0.1193, rel=1e-3)
    # A shell that is thicker than the object leaves it solid.
    assert mass_as_made(entry(of=shape(BLOCK), shell_m="0.09")) == pytest.approx(1.5)


def test_what_is_held_weighs_no_fifteen_kilograms():
    (finding,) = check(entry(material="steel", of=shape(BLOCK)))
    assert (finding.severity, finding.field) == (WARNING, "shell_m")
    assert "15.7 kg at a length of 0.2 m" in finding.found
    assert list(check(entry(material="steel", of=shape(BLOCK), shell_m="0.001"))) == []
    assert list(check(entry(of=shape(BLOCK)))) == []


def test_furniture_may_be_heavy_but_not_absurdly():
    assert list(check(entry(of=shape((2.0, 1.0, 0.05))))) == []
    (finding,) = check(entry(material="steel", of=shape((0.9, 0.5, 0.5))))
    assert "1.77e+03 kg" in finding.found


def test_nothing_is_said_of_what_is_open_or_not_there():
    assert list(check(entry(of=shape(BLOCK, closed=False, boundary_edges=3), mass_kg="9"))) == []
    assert list(check(entry(mass_kg="9"))) == []


def test_what_weighs_next_to_nothing_may_be_in_another_unit():
    (finding,) = check(entry(of=shape((0.02, 0.01, 0.01))))
    assert "1.5 g at a length of 0.02 m" in finding.found
    assert "its unit" in finding.remedy
