"""Stored results and the code of their benches belong together."""

import json
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from bench import record

NAMES = sorted(path.stem for path in record.RESULTS.glob("*.json"))


@pytest.mark.parametrize("name", NAMES)
def test_every_picture_can_be_drawn_again_from_the_stored_figures(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Path] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, path, **settings: drawn.append(path))
    record.redraw(name)
    assert drawn == [record.RESULTS / f"{name}.png"]
    assert drawn[0].exists()


@pytest.mark.parametrize("name", NAMES)
def test_every_result_says_what_was_compared_how_and_by_which_code(name: str) -> None:
    found = record.stored(name)
    assert found["name"] == name
    assert found["compared"]
    assert found["figures"]
    assert found["settings"]
    assert found["versions"]["commit"]


@pytest.mark.parametrize("name", NAMES)
def test_no_result_names_a_folder_of_the_machine(name: str) -> None:
    text = json.dumps(record.stored(name))
    assert not any(f"{place}/" in text for place in ("/home", "/root", "/tmp", "/work", str(Path.home())))
