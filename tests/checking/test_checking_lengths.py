"""Slips of unit, lengths of another side, and lengths that are right."""

import pytest
from checked_rows import entry, shape

from pipeline.intake.check.entry import ERROR, NOTE, WARNING
from pipeline.intake.check.mesh_rules import check_length as check

MUG = (0.117, 0.0931, 0.0813)
YCB = {"source": "YCB Object and Model Set"}


def only(row):
    (finding,) = check(row)
    return finding


@pytest.mark.parametrize(
    ("length", "file_extents", "source"),
    [
        ("", MUG, YCB),  # as in the file
        ("0.117", MUG, YCB),
        ("0.119", MUG, YCB),  # within what scans differ by
        ("0.117", (117.0, 93.1, 81.3), {}),  # one's own, in millimetres: the length is what says so
        ("0.117", (1.0, 0.796, 0.695), {}),  # normalised
    ],
)
def test_lengths_that_are_right(length, file_extents, source):
    row = entry("blue_mug", "ceramic", of=shape(MUG, file_extents=file_extents), length_m=length, **source)
    assert list(check(row)) == []


def test_the_height_is_not_the_longest_side():
    row = entry("mug", "steel", of=shape((0.118, 0.094, 0.082), file_extents=MUG), length_m="0.082", **YCB)
    finding = only(row)
    assert (finding.severity, finding.field) == (WARNING, "length_m")
    assert "0.701 times the longest side" in finding.found
    assert "side along z (0.0813)" in finding.found
    assert "Give the longest side (0.117)" in finding.remedy


def test_a_cube_has_no_other_side():
    # Each side of a die is the longest within the noise of a scan.
    row = entry("die", of=shape((0.0176, 0.0172, 0.0171)), length_m="0.0171")
    assert list(check(row)) == []


@pytest.mark.parametrize(
    ("length", "severity", "finding"),
    [
        ("0.13", WARNING, "1.11 times the longest side of the mesh, 0.117, which is in metres"),
        ("0.735", ERROR, "6.28 times"),
        ("117", ERROR, "1e+03 times"),  # millimetres taken for metres
    ],
)
def test_a_source_in_metres_is_not_to_be_scaled(length, severity, finding):
    row = entry("object", of=shape((0.1, 0.1, 0.1), file_extents=MUG), length_m=length, **YCB)
    fault = only(row)
    assert fault.severity == severity
    assert finding in fault.found


def test_the_paper_had_another_length():
    row = {"of": shape(MUG), "paper_length_m": "0.082"}
    finding = only(entry("mug", "steel", **row))
    assert (finding.severity, finding.field) == (WARNING, "paper_length_m")
    assert "0.117 m, where the paper has 0.082 m (0.701 times as long)" in finding.found
    assert only(entry("mug", "steel", notes="its height", **row)).severity == NOTE
    assert list(check(entry("mug", "steel", of=shape(MUG), paper_length_m="0.118"))) == []
    assert list(check(entry("mug", "steel", of=shape(MUG), paper_length_m="None"))) == []
