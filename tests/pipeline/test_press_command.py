"""`objectfolder press` with all that a touch can be asked for."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import objectfolder
from objectfolder.touch.sensor.reading import synthetic_background
from pipeline.cli import main

pytestmark = pytest.mark.usefixtures("quiet")


@pytest.fixture
def contacts(small_file: Path, tmp_path: Path) -> Path:
    points, _ = objectfolder.load(small_file).sample_contacts(2, seed=3, reachable=False)
    np.save(tmp_path / "points.npy", points)
    return tmp_path / "points.npy"


def test_every_option_reaches_the_sensor(small_file: Path, contacts: Path, tmp_path: Path) -> None:
    bar = objectfolder.load(small_file)
    background = synthetic_background(bar.touch.sensor.at_resolution(80, 60), 1)
    Image.fromarray(background).save(tmp_path / "gel.png")
    options = ["--depth", "0.0008", "--tilt", "10", "--azimuth", "30", "--roll", "25", "--contact", "rigid"]
    options += ["--resolution", "80", "60", "--noise-seed", "4", "--background", str(tmp_path / "gel.png")]
    output = tmp_path / "touches"
    assert main(["press", str(small_file), "--points", str(contacts), *options, "-o", str(output)]) == 0
    expected = bar.press(
        np.load(contacts),
        0.0008,
        10,
        30,
        roll_deg=25,
        resolution=(80, 60),
        noise_seed=4,
        background=background,
    )
    images = [np.asarray(Image.open(output / f"{index:04d}.png")) for index in range(2)]
    np.testing.assert_array_equal(images, expected.rgb)
    np.testing.assert_array_equal(np.load(output / "depth.npy"), expected.depth_m)
    labels = json.loads((output / "labels.json").read_text(), parse_constant=pytest.fail)
    assert labels["force_n"] == [None, None]
    assert labels["saturated"] == [False, False]
    np.testing.assert_array_equal(labels["sensor_to_object"], expected.sensor_to_object)


def test_a_background_is_drawn_where_none_is_at_hand(
    small_file: Path, contacts: Path, tmp_path: Path
) -> None:
    touches = tmp_path / "touches"
    press = ["press", str(small_file), "--points", str(contacts), "-o", str(touches)]
    assert main([*press, "--background", "synthetic", "--noise-seed", "2"]) == 0
    bar = objectfolder.load(small_file)
    background = synthetic_background(bar.touch.sensor, 2)
    expected = bar.press(np.load(contacts), background=background, noise_seed=2)
    np.testing.assert_array_equal(np.asarray(Image.open(touches / "0001.png")), expected.rgb[1])


def test_a_depth_or_a_force_and_not_both(small_file: Path, contacts: Path, tmp_path: Path) -> None:
    press = ["press", str(small_file), "--points", str(contacts), "-o", str(tmp_path / "touches")]
    assert main([*press, "--depth", "0.001", "--force", "1"]) == 2
    assert main([*press, "--force", "1", "--contact", "rigid"]) == 1


def test_a_background_that_is_no_image_is_named(
    small_file: Path, contacts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    press = ["press", str(small_file), "--points", str(contacts), "-o", str(tmp_path / "touches")]
    assert main([*press, "--background", str(contacts)]) == 1
    assert "points.npy: not an image" in capsys.readouterr().err


def test_info_says_how_much_of_the_surface_the_sensor_reaches(
    small_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(small_file)]) == 0
    share = objectfolder.load(small_file).description["fidelity"]["touch"]["unreachable_share"]
    assert f"{100 * share:.0f} % of the surface out of the sensor's reach" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        (["--resolution", "1", "1"], "resolution: 1. Give a whole number, 2 to"),
        (["--resolution", "0", "9", "--background", "synthetic"], "resolution: 0. Give"),
        (["--depth", "nan"], "depth_m: not finite"),
        (["--noise-seed", "-1"], "noise_seed: -1. Give a whole number"),
    ],
)
def test_what_makes_no_sense_is_one_line(
    small_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], asked: list[str], named: str
) -> None:
    assert main(["press", str(small_file), *asked, "-o", str(tmp_path / "touches")]) == 1
    said = capsys.readouterr().err
    assert named in said
    assert said.count("\n") == 1
