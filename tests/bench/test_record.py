"""Results of comparisons as files."""

import json
from pathlib import Path

import numpy as np
import pytest

from bench import record


def test_figures_are_kept_with_settings_versions_and_what_was_compared(tmp_path: Path) -> None:
    figures = {"seconds": np.float64(1.5), "errors": np.array([1, 2]), "rival": None}
    path = record.write(
        "rates", figures, {"cases": ("a", "b")}, "ours against the rival", folder=tmp_path / "new"
    )
    assert path == tmp_path / "new" / "rates.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    assert document["figures"] == {"seconds": 1.5, "errors": [1, 2], "rival": None}
    assert document["settings"] == {"cases": ["a", "b"]}
    assert document["compared"] == "ours against the rival"
    assert document["versions"]["numpy"] == np.__version__
    assert document["versions"]["processor"]


def test_numbers_that_are_not_finite_and_foreign_values_leave_no_file(tmp_path: Path) -> None:
    for value, error in ((np.nan, ValueError), (np.array([np.inf]), ValueError), (object(), TypeError)):
        with pytest.raises(error):
            record.write("rates", {"value": value}, {"cases": 1}, "nothing", folder=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("figures", "settings", "compared", "message"),
    [
        ({}, {"cases": 1}, "ours", "no figures"),
        ({"seconds": 1.0}, {}, "ours", "no settings"),
        ({"seconds": 1.0}, {"cases": 1}, "", "no compared"),
        ({"seconds": 1.0}, {"mesh": str(record.REPOSITORY / "mug.obj")}, "ours", "a folder of this machine"),
    ],
)
def test_a_result_says_what_was_compared_and_how_and_names_no_folder(
    figures: dict[str, float], settings: dict[str, object], compared: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        record.write("rates", figures, settings, compared, folder=tmp_path)
    assert not list(tmp_path.iterdir())


def test_every_picture_is_of_a_module_and_its_figures() -> None:
    names = record.pictures()
    assert "discretisation" in names
    for name in names:
        assert len([*record.REPOSITORY.glob(f"bench/[fsr]*/{name}.py")]) == 1, name
        assert record.stored(name)["figures"], name
