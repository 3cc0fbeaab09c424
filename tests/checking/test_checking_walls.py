"""Walls, open surfaces, and what a table accepts."""

import dataclasses

import numpy as np
import pytest
from checked_rows import entry, shape

from objectfolder.errors import InputError
from objectfolder.making.mesh.cleaning import clean
from pipeline.intake.check.entry import ERROR, NOTE, WARNING
from pipeline.intake.check.mesh_rules import check_surface, check_walls
from pipeline.intake.check.row_rules import check_readable
from pipeline.intake.check.table_check import accept
from tests.small_meshes import bare_mesh, sphere


def test_a_can_of_known_mass_is_scanned_solid():
    can = {"of": shape((0.14, 0.1, 0.1)), "mass_kg": "0.414", "name": "Coffee can"}
    (finding,) = check_walls(entry("can", "steel", **can))
    assert (finding.severity, finding.field) == (WARNING, "shell_m")
    assert finding.found.startswith("too thick (certain)")
    assert "gives the published 0.414 kg" in finding.remedy
    assert list(check_walls(entry("can", "steel", shell_m="0.0003", **can))) == []


def test_a_solid_block_has_no_walls():
    assert list(check_walls(entry("block", of=shape((0.2, 0.1, 0.1)), mass_kg="1.4"))) == []
    assert list(check_walls(entry("block"))) == []


def test_masses_alone_are_left_to_the_rule_of_masses():
    row = entry("block", of=shape((0.05, 0.03, 0.03)), mass_kg="0.003")
    assert list(check_walls(row)) == []


def test_open_surfaces():
    (finding,) = check_surface(entry(of=shape(closed=False, boundary_edges=376)))
    assert (finding.severity, finding.field) == (WARNING, "mesh")
    assert "376 boundary and 0 non-manifold edges" in finding.found
    (finding,) = check_surface(entry(of=shape(closed=False)))
    assert "wound inconsistently" in finding.found
    assert list(check_surface(entry(of=shape()))) == []
    assert list(check_surface(entry())) == []


def test_what_cleaning_found_is_said():
    """Two balls that both face outward, and each face a second time, back to back."""
    vertices, faces = sphere(0.05, 2)
    layers = np.concatenate([faces, faces + len(vertices), faces[:, ::-1]])
    report = clean(bare_mesh(np.concatenate([vertices, 0.9 * vertices]), layers))[1]
    nested, doubled = check_surface(entry(of=dataclasses.replace(shape(), cleaning=report)))
    assert (nested.severity, doubled.severity) == (WARNING, NOTE)
    assert "1 closed pieces lie in others" in nested.found
    assert f"{len(faces)} faces lie back to back" in doubled.found


@pytest.mark.parametrize(
    ("remedy", "severity", "found"),
    [
        ("objectfolder fetch ycb:025_mug", NOTE, "is not fetched"),
        ("Correct the path or add the file", ERROR, "the file mug.obj does not exist"),
    ],
)
def test_rows_that_cannot_be_read(remedy, severity, found):
    problem = InputError("mug (t.csv line 2), field texture", "the file mug.obj does not exist", remedy)
    row = dataclasses.replace(entry("mug"), record=None, problem=problem)
    (finding,) = check_readable(row)
    assert (finding.severity, finding.field, finding.remedy) == (severity, "texture", remedy)
    assert found in finding.found


@pytest.mark.parametrize("value", ["heavy", "0", "inf"])
def test_numbers_that_are_none(value):
    (finding,) = check_readable(entry(paper_length_m=value))
    assert (finding.field, finding.severity) == ("paper_length_m", WARNING)


def test_ordinary_cells_are_read():
    assert list(check_readable(entry(mass_kg="0.1", paper_length_m="", paper_index="7"))) == []


def doubt(row, severity=WARNING, rule="mass"):
    return row.finding(rule, severity, "mass_kg", "9 times the published", "State shell_m")


def test_a_doubt_that_was_looked_at_is_a_note():
    row = entry(accepted="mass; walls", notes="its base is filled")
    mass, licence = accept(row, [doubt(row), doubt(row, rule="licence")])
    assert (mass.severity, mass.accepted) == (NOTE, True)
    assert (licence.severity, licence.accepted) == (WARNING, False)


def test_errors_and_unexplained_doubts_stay():
    row = entry(accepted="mass", notes="so be it")
    (finding,) = accept(row, [doubt(row, ERROR)])
    assert (finding.severity, finding.accepted) == (ERROR, False)
    unexplained = entry(accepted="mass")
    reason, finding = accept(unexplained, [doubt(unexplained)])
    assert "without a reason" in reason.found
    assert finding.severity == WARNING


def test_acceptances_of_nothing_and_of_no_rule():
    (finding,) = accept(entry(accepted="mas", notes="why"), [])
    assert (finding.severity, finding.remedy) == (WARNING, "Did you mean mass?")
    (finding,) = accept(entry(of=shape(), accepted="mass", notes="why"), [])
    assert "finds nothing" in finding.found
    # What is not fetched was not looked at.
    assert list(accept(entry(accepted="mass", notes="why"), [])) == []
