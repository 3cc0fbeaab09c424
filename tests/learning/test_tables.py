"""The tables of the page of results, from the files that are recorded."""

import json
import sys
from pathlib import Path

import pytest

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
    assert sorted(task for folder, task in marks if not folder) == sorted(learning_tables.TABLES)
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
