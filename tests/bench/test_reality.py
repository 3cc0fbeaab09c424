"""The page of the comparison with real things."""

import json
from pathlib import Path

import numpy as np
import pytest

from bench.reality import sound
from bench.reality.fitted_sound import _in_common
from bench.reality.plots import DECAYS, PHOTOGRAPHS, draw
from bench.reality.row import Aim, Row, page


def test_the_page_groups_lines_by_sense_and_cites_each_source_once():
    aims = Aim("median", most=1.4), Aim("worst", most=1.6)
    row = Row("sound", "a bowl", "decay", {"median": 1.04, "worst": 1.9}, "", "", "all", "Who, 2024", 2, aims)
    second_row = Row(
        "touch", "a gel", "force, %", {"worst": 2.5}, "1 %", "its modulus", "half", "Whom, 2023", 0.2
    )
    text = page([row, row, second_row])
    outcome = "median at most 1.4: met; worst at most 1.6: **missed by 0.3**"
    assert text.count(f"median 1.04, worst 1.9 | {outcome} | not known | nothing | all | 2.0 |") == 2
    assert text.index("## Sound") < text.index("a bowl") < text.index("## Touch") < text.index("a gel")
    assert text.count("Who, 2024") == 1
    assert Aim("off", most=51.0).verdict({"off": -124.0}) == "off at most 51: **missed by 73**"
    assert Aim("mean", least=23.0).verdict({"mean": 22.5}) == "mean at least 23: **missed by 0.5**"
    assert "](touch.svg)\n\n## Sources" in page([row, second_row], {"touch": "touch.svg"})


@pytest.mark.slow
def test_pictures_are_small_and_the_same_for_the_same_figures(tmp_path: Path) -> None:
    about = ("", "", "all", "Who, 2024", 2.0)
    rows = [
        Row("sound", "a bowl", "decay of 20 partials, factor", {"median": 1.04, "rms": 1.9}, *about),
        Row("touch", "a gel", "window, PSNR in dB", {"mean": 28.0, "worst": 26.0, "no touch": 18.0}, *about),
    ]
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        draw(rows, tmp_path / folder)
    for name in (DECAYS, PHOTOGRAPHS):
        content = (tmp_path / "a" / name).read_bytes()
        assert content == (tmp_path / "b" / name).read_bytes()
        assert len(content) < 50_000
    assert "a bowl" in (tmp_path / "a" / DECAYS).read_text()
    assert "a gel" in (tmp_path / "a" / PHOTOGRAPHS).read_text()


def test_decays_are_those_of_what_lies_over_the_tables_within_the_band(tmp_path: Path) -> None:
    """Half the time for 60 dB is twice the decay rate; what is outside of the band does not count."""
    glass = sound.read_materials(sound.MATERIALS)["glass"]
    hertz = np.array([100.0, 1000.0, 8000.0, 17000.0])
    rates = np.pi * hertz * glass.loss_factor + sound.LYING_PER_S
    path = tmp_path / "glass.json"
    path.write_text(json.dumps({"cf": hertz.tolist(), "rt": (3 * np.log(10) / rates / 2).tolist()}))
    np.testing.assert_allclose(sound._decay_ratios(path, glass), [0.5, 0.5])
    assert sound._rms_factor(np.array([2.0, 0.5])) == pytest.approx(2)


def test_a_partial_that_is_matched_stands_for_one_that_is_listed() -> None:
    listed_hz = np.array([1681.2, 1684.3, 4168.5])
    assert _in_common(np.array([1682.0]), listed_hz) == 1
    assert _in_common(np.array([1681.0, 1684.0, 9000.0]), listed_hz) == 2
