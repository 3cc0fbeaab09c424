"""``objectfolder render`` with lights, environments, crops and passes."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import objectfolder
from objectfolder.object_file import ObjectFile
from objectfolder.vision.cameras import look_at
from objectfolder.vision.environment import Environment
from objectfolder.vision.lamps import Lamps
from pipeline.cli import main

LIT = ["--light", "0", "0", "1", "1", "1", "1"]
CAMERAS = np.array([[1.2, -1.6, 1.4], [-0.9, 1.0, 2.0]])


@pytest.fixture(scope="module")
def bar(small_file: Path) -> ObjectFile:
    return objectfolder.load(small_file)


@pytest.fixture
def command(small_file: Path, tmp_path: Path) -> list[str]:
    np.save(tmp_path / "cameras.npy", CAMERAS)
    return ["render", str(small_file), "--views", str(tmp_path / "cameras.npy"), "--resolution", "24",
            "--frame", "unit", "--overwrite", "-o", str(tmp_path / "images")]  # fmt: skip


def test_lights_crop_and_passes_are_those_of_the_query(
    bar: ObjectFile, command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lights = ["--light", "0", "0.6", "0.8", "2", "1", "0.5", "--light", "-1", "0", "0", "1", "1", "1"]
    crop = ["--crop", "3", "2", "15", "20"]
    passes = ["--passes", "depth", "--passes", "normal", "--passes", "mask"]
    assert main([*command, *lights, *crop, *passes]) == 0
    assert "2 images of 15 x 20 pixels with depth, normal, mask, 2 lights" in capsys.readouterr().out
    positions = bar.frame.to_object(np.array([[[0, 0.6, 0.8], [-1, 0, 0]]]))
    expected = bar.render_passes(
        bar.frame.camera_to_object(look_at(CAMERAS)),
        ["image", "depth", "normal", "mask"],
        Lamps(positions, np.array([[2, 1, 0.5], [1, 1, 1]])),
        24,
        crop=(3, 2, 15, 20),
    )
    for index in range(2):
        stem = str(tmp_path / "images" / f"{index:04d}")
        np.testing.assert_array_equal(np.asarray(Image.open(stem + ".png")), expected["image"][index])
        np.testing.assert_array_equal(np.asarray(Image.open(stem + "_mask.png")) > 0, expected["mask"][index])
        np.testing.assert_array_equal(np.load(stem + "_depth.npy"), expected["depth"][index])
        np.testing.assert_array_equal(np.load(stem + "_normal.npy"), expected["normal"][index])
    assert expected["mask"].any()


def test_positions_are_in_metres_of_the_object_unless_said_otherwise(
    bar: ObjectFile, command: list[str], tmp_path: Path
) -> None:
    lamp = np.array([0.2, -0.6, 0.8])
    shift = bar.frame.to_object(np.concatenate([CAMERAS, [lamp]]))
    np.save(tmp_path / "metres.npy", shift[:2])
    images = []
    for more in (["--light", *map(repr, lamp.tolist())],
                 ["--views", str(tmp_path / "metres.npy"), "--frame", "object",
                  "--light", *map(repr, shift[2].tolist())]):  # fmt: skip
        words = command if "--views" not in more else [*command[:2], *command[4:6], *command[8:]]
        assert main([*words, *more, "1", "1", "1"]) == 0
        images.append(np.asarray(Image.open(tmp_path / "images" / "0001.png")).astype(int))
    assert (images[0] < 255).any()
    assert np.abs(images[0] - images[1]).max() <= 1


@pytest.mark.parametrize("suffix", ["exr", "hdr"])
def test_an_environment_is_read_as_it_was_written(
    bar: ObjectFile, command: list[str], tmp_path: Path, suffix: str
) -> None:
    os.environ.setdefault("OPENCV_IO_ENABLE_OPENEXR", "1")
    import cv2

    radiance = np.exp(np.random.default_rng(0).normal(0, 1, (8, 16, 3))).astype(np.float32)
    path = tmp_path / f"around.{suffix}"
    assert cv2.imwrite(str(path), np.ascontiguousarray(radiance[..., ::-1]))
    assert main([*command, "--environment", str(path)]) == 0
    images = bar.render(bar.frame.camera_to_object(look_at(CAMERAS)), Environment.of(radiance), 24)
    for index in range(2):
        image = np.asarray(Image.open(tmp_path / "images" / f"{index:04d}.png")).astype(int)
        # Radiance files have 8 bits a channel.
        assert np.abs(image - images[index]).max() <= (0 if suffix == "exr" else 3)


@pytest.mark.parametrize(("more", "option"), [
    (["--light", "1", "2"], "--light"),
    ([*LIT, "--crop", "1", "2", "3"], "--crop"),
    ([*LIT, "--passes", "shine"], "--passes"),
])  # fmt: skip
def test_wrong_options_are_named(
    command: list[str], capsys: pytest.CaptureFixture[str], more: list[str], option: str
) -> None:
    assert main([*command, *more]) == 2
    assert option in capsys.readouterr().err


@pytest.mark.parametrize(("more", "word"), [
    ([], r"shape \(2, 3\). Give an \(n, 6\) array"),
    (["--light", "1", "2", "nan", "1", "1", "1"], "--light"),
    ([*LIT, "--crop", "20", "0", "10", "10"], "crop: 10 x 10 pixels at row 20"),
    ([*LIT, "--environment", "nowhere.exr"], "--light: beside --environment"),
    (["--environment", "nowhere.exr"], "nowhere.exr: no such file"),
    (["--environment", __file__], "not a map of linear radiance"),
])  # fmt: skip
def test_what_cannot_be_rendered_is_said(
    command: list[str], capsys: pytest.CaptureFixture[str], more: list[str], word: str
) -> None:
    assert main([*command, *more]) == (2 if word.startswith("--") else 1)
    assert re.search(word, capsys.readouterr().err)
