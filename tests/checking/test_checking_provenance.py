"""Sources, attributions, addresses and licences."""

import pytest
from checked_rows import entry

from pipeline.intake.check.entry import ERROR, NOTE, WARNING
from pipeline.intake.check.row_rules import check_licence, check_provenance

MUG = {
    "source": "YCB Object and Model Set",
    "licence": "CC-BY-4.0",
    "attribution": "Calli et al.",
    "source_id": "ycb:025_mug",
    "source_url": "https://ycb-benchmarks.s3.amazonaws.com/data/google/025_mug_google_16k.tgz",
}
OWN = {"source": "my desk", "licence": "CC0-1.0", "attribution": "me"}


@pytest.mark.parametrize(
    "cells", [MUG, OWN, {**OWN, "licence": "LicenseRef-mine"}, {**OWN, "licence": "MIT OR X11"}]
)
def test_rows_that_say_where_they_are_from(cells):
    assert [*check_provenance(entry(**cells)), *check_licence(entry(**cells))] == []


@pytest.mark.parametrize(
    ("cells", "column", "severity"),
    [(OWN, "source", WARNING), (OWN, "attribution", NOTE), (MUG, "attribution", WARNING)],
)
def test_what_is_missing(cells, column, severity):
    """The public domain asks for no name."""
    (finding,) = check_provenance(entry(**{**cells, column: ""}))
    assert (finding.severity, finding.field, finding.found) == (severity, column, "is empty")


@pytest.mark.parametrize(
    ("source_id", "remedy"),
    [
        ("yb:025_mug", "Did you mean ycb?"),
        ("025_mug", "ycb:025_mug"),
        ("ycb:", ""),
        ("polyhaven:Tele vision", ""),
    ],
)
def test_a_source_that_nothing_fetches(source_id, remedy):
    (finding,) = check_provenance(entry(**{**OWN, "source_id": source_id}))
    assert (finding.severity, finding.field) == (ERROR, "source_id")
    assert source_id in finding.found
    assert remedy in finding.remedy


def test_two_sources_in_one_row():
    (finding,) = check_provenance(entry(**{**MUG, "source": "Google Scanned Objects"}))
    assert "'ycb:025_mug' is of another source than 'Google Scanned Objects'" in finding.found


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("CC BY 4.0", "CC-BY-4.0"),
        ("cc-by-4.0", "CC-BY-4.0"),
        ("CC-BY", "CC-BY-4.0"),
        ("Creative Commons Attribution-ShareAlike 4.0", "CC-BY-SA-4.0"),
        ("CC0", "CC0-1.0"),
        ("CC0 1.0 Universal (Public Domain)", "CC0-1.0"),
    ],
)
def test_licences_as_people_write_them(said, meant):
    (finding,) = check_licence(entry(**{**OWN, "licence": said}))
    assert (finding.severity, finding.remedy) == (WARNING, f"Write {meant}")


@pytest.mark.parametrize("said", ["all rights reserved", "CC-BY-9.9"])
def test_licences_that_nobody_knows(said):
    (finding,) = check_licence(entry(**{**OWN, "licence": said}))
    assert finding.severity == WARNING
    assert "spdx.org/licenses" in finding.remedy


def test_no_licence():
    (finding,) = check_licence(entry(**{**OWN, "licence": ""}))
    assert (finding.severity, finding.found) == (WARNING, "is empty")


def test_a_licence_that_is_not_the_sources():
    (finding,) = check_licence(entry(**{**MUG, "licence": "CC0-1.0"}))
    assert finding.severity == ERROR
    assert "not the licence of YCB Object and Model Set, CC-BY-4.0" in finding.found
    # Written otherwise it is still the right one.
    (finding,) = check_licence(entry(**{**MUG, "licence": "CC BY 4.0"}))
    assert (finding.severity, finding.remedy) == (WARNING, "Write CC-BY-4.0")


@pytest.mark.parametrize(("licence", "severity"), [("CC-BY-ND-4.0", WARNING), ("CC-BY-NC-4.0", NOTE)])
def test_licences_that_forbid_what_is_made(licence, severity):
    (finding,) = check_licence(entry(**{**OWN, "licence": licence}))
    assert finding.severity == severity
