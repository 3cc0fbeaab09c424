"""The tables of the page of results, from the files that are recorded."""

import json
import re
import sys
from pathlib import Path

import pytest
from jinja2 import Environment, FileSystemLoader, StrictUndefined

REPOSITORY = Path(__file__).parents[2]
RESULTS = REPOSITORY / "learning" / "results"


@pytest.fixture(scope="module")
def learning_tables():
    pytest.importorskip("mkdocs")
    sys.path.insert(0, str(REPOSITORY / "docs"))
    try:
        import learning_tables

        return learning_tables
    finally:
        sys.path.pop(0)


def test_the_page_has_a_table_of_every_task(learning_tables):
    page = (REPOSITORY / "docs" / "learning_results.md").read_text(encoding="utf-8")
    marks = learning_tables.MARK.findall(page)
    assert sorted(task for folder, task in marks if not folder) == sorted(
        {*learning_tables.TABLES} - {"touch"}
    )
    assert ("hundred/", "touch") in marks, "the meshes of the hundred alone are touched so"
    for folder, task in marks:
        text = learning_tables.table(task, RESULTS / folder)
        lines = [line for line in text.splitlines() if line.startswith("|")]
        assert len({line.count("|") for line in lines[:3]}) == 1


def test_a_table_has_what_the_file_says(learning_tables, tmp_path):
    (tmp_path / "settings").mkdir()
    for name in ("stand_in.json", "settings/stand_in.json"):
        (tmp_path / name).write_text((RESULTS / name).read_text(encoding="utf-8"), encoding="utf-8")
    figures = json.loads((tmp_path / "stand_in.json").read_text(encoding="utf-8"))
    figures["recognition"]["T"]["truth to truth"] = 12.34
    (tmp_path / "stand_in.json").write_text(json.dumps(figures), encoding="utf-8")
    text = learning_tables.table("stand_in", tmp_path)
    (touch,) = [line for line in text.splitlines() if line.startswith("| touch")]
    assert " 12.3 |" in touch


def _with_unseen(figures):
    """Figures of regrasping as a run with folds writes them."""
    row = figures["held"]["fixed move"] | {"percent": 43.21}
    ahead = {"points": 7.65, "interval_points": [-1.25, 9.5]}
    unseen = {
        "folds": [["bell", "mug"], ["bowl", "fork"]],
        "fixed_moves": [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]],
        "held": {"touch": row, "fixed move": row},
        "lost": {"touch": ahead},
        "touch_ahead": {"random": ahead, "fixed move": ahead},
    }
    return figures | {"unseen": unseen}


def test_objects_left_out_of_regrasping_have_a_table_where_they_were_asked_for(learning_tables):
    figures = json.loads((RESULTS / "regrasping.json").read_text(encoding="utf-8"))
    figures.pop("unseen", None)
    plain, whole = (learning_tables.regrasping(each) for each in (figures, _with_unseen(figures)))
    assert whole.startswith(plain)
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in whole[len(plain) :].split("\n") if line
    ]
    assert {row[0]: row[-2:] for row in rows[2:]} == {
        "fixed move": ["", "+7.7 (-1.2 to +9.5)"],
        "random": ["", "+7.7 (-1.2 to +9.5)"],
        "touch": ["+7.7 (-1.2 to +9.5)", ""],
    }
    assert {len(row) for row in rows} == {5}
    assert " 43.2 (" in whole
    assert " 43.2 (" not in plain


def test_the_page_says_what_objects_left_out_of_regrasping_came_to():
    figures = json.loads((RESULTS / "regrasping.json").read_text(encoding="utf-8"))
    figures.pop("unseen", None)
    settings = json.loads((RESULTS / "settings" / "regrasping.json").read_text(encoding="utf-8"))
    environment = Environment(
        loader=FileSystemLoader(REPOSITORY / "learning"), autoescape=True, undefined=StrictUndefined
    )
    plain, whole = (
        environment.get_template("page.html.j2").render(
            regrasping=each | settings, ids=[], rows=[], shapes=[], clips={"regrasping": []}
        )
        for each in (figures, _with_unseen(figures))
    )
    assert "left out" not in plain
    assert re.search(r"touch, object left out<td>43\.2<td>", whole)
    assert "Touch loses +7.7 points (-1.2 to +9.5) by that." in whole
    assert re.search(r"ahead\s+of random by \+7\.7 points \(-1\.2 to \+9\.5\), of fixed move by", whole)
