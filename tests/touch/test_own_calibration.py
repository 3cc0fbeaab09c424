"""A sensor is calibrated by photographs whose truth is known: those of the library's own sensor."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from touch_shapes import sphere

from objectfolder.errors import InputError
from objectfolder.making import calibrate
from objectfolder.making.sensor import own_calibration
from objectfolder.making.sensor.ball_prints import Print, find_prints
from objectfolder.making.sensor.own_calibration import OwnCalibration
from objectfolder.surface.surface import Surface
from objectfolder.touch import Press, press, read_sensor
from objectfolder.touch.elastic.markers import Markers
from objectfolder.touch.presses.press import render_poses
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.magnification import pixels_per_metre
from objectfolder.touch.sensor.marker_grid import MarkerGrid
from objectfolder.touch.sensor.marker_tracking import track_markers
from pipeline.cli import main
from pipeline.intake.sensor_photographs import read_photographs

TRUE = read_sensor("digit-tacto").at_resolution(160, 120)
RADIUS, DEPTH = 0.004, 0.001
BALL = Surface(*sphere(RADIUS, 4))
# From the gel's middle, metres.
PLACES = np.array([(x, y) for x in (-0.0035, 0.0, 0.0035) for y in (-0.006, -0.003, 0.0, 0.003, 0.006)])

GRID = MarkerGrid(10, 8, 2.5e-3, 2.5e-3, 2.0, 0.0, 0.0, 3.5e-4)


@pytest.fixture(scope="module")
def photographs() -> tuple[np.ndarray, np.ndarray]:
    poses = np.tile(np.eye(4), (len(PLACES), 1, 1))
    apex = np.asarray(TRUE.gel_apex_m)
    for pose, place in zip(poses, PLACES, strict=True):
        sag = float(np.sum(place**2)) / 0.065
        pose[:3, 3] = -(apex + np.array([RADIUS - DEPTH - sag, *place]))
    random = np.random.default_rng(0)
    images = np.stack([image.rgb for image in render_poses(BALL, TRUE, poses)])
    noisy = np.clip(images + random.normal(0, 1.5, images.shape), 0, 255).astype(np.uint8)
    return noisy, no_contact_image(TRUE)


@pytest.fixture(scope="module")
def with_markers(photographs) -> tuple[np.ndarray, np.ndarray]:
    """The photographs of the same gel with dots on it."""
    images, untouched = photographs
    scale = pixels_per_metre(TRUE)
    places = np.array([79.5, 59.5]) + GRID.places_m() * scale
    nothing = np.zeros((len(places), 3))
    markers = Markers(nothing, nothing, places, places, GRID.dot_radius_m * scale)
    return np.stack([markers.drawn_on(image) for image in images]), markers.drawn_on(untouched)


@pytest.fixture(scope="module")
def calibration(photographs) -> OwnCalibration:
    return calibrate(*photographs, TRUE, RADIUS)


def test_circles_are_found_where_the_ball_was_pressed(photographs) -> None:
    images, untouched = photographs
    scale = pixels_per_metre(TRUE)
    blank = untouched[None].astype(int)
    noise = np.random.default_rng(1).normal(0, 1.5, blank.shape)
    prints = find_prints(np.concatenate([images.astype(int) - blank, noise]), RADIUS * scale)
    for place, mark in zip(PLACES, prints[:-1], strict=True):
        assert isinstance(mark, Print)
        assert mark.column == pytest.approx(59.5 - place[0] * scale, abs=3)
        assert mark.row == pytest.approx(79.5 - place[1] * scale, abs=3)
    assert str(prints[-1]).startswith("no mark")


@pytest.mark.slow
def test_a_curved_gel_is_calibrated_and_says_what_it_does_not_know(photographs, calibration) -> None:
    result, (_, untouched) = calibration, photographs
    assert result.held_out.mean() > result.nothing.mean() + 8
    assert result.held_out.mean() > result.mean_patch.mean()
    # Nothing changes round a rigid touch of this sensor, and the response invents nothing.
    assert result.held_out_around.mean() > result.held_out.mean() + 3
    # What no ball showed is less certain than what one did.
    steep = result.uncertainty[-1].mean()
    assert steep > 3 * result.uncertainty[1:3].mean()
    larger = Surface(*sphere(0.006, 4))
    query = np.array([[0.0, 0.0, 0.006]]), Press(depth_m=0.0006, samples=1)
    truth, answer = (press(larger, sensor, *query) for sensor in (TRUE, result.sensor))
    touched = truth.mask[0]
    error = (truth.rgb[0].astype(float) - answer.rgb[0])[touched]
    empty = (truth.rgb[0].astype(float) - untouched)[touched]
    assert (error**2).mean() < 0.2 * (empty**2).mean()


@pytest.mark.slow
@pytest.mark.release("objectfolder.touch", "objectfolder.making.sensor")
def test_a_gel_with_markers_is_calibrated_as_well_as_one_without(with_markers, calibration) -> None:
    result = calibrate(*with_markers, TRUE, RADIUS)
    assert result.markers is not None
    assert result.markers.followed.tolist() == [80] * 15
    assert result.sensor.marker_grid == result.markers.grid
    assert result.held_out.mean() > calibration.held_out.mean() - 1.5
    assert result.held_out_around.mean() > calibration.held_out_around.mean() - 1.5
    # No dots are left in what it shows untouched.
    assert np.abs(result.untouched.astype(int) - calibration.untouched).max() < 12


def test_balls_and_photographs_that_cannot_be_are_refused(photographs) -> None:
    images, untouched = photographs
    with pytest.raises(InputError, match="24 mm is larger than the gel of 20 x 30 mm"):
        calibrate(images, untouched, TRUE, 0.012)
    for radius in (0.0, float("nan"), RADIUS / 1000):
        with pytest.raises(InputError, match="pixels of pictures of 120 x 160"):
            calibrate(images, untouched, TRUE, radius)
    with pytest.raises(InputError, match=r"1 of 2 photographs show a contact circle; the first .*: no mark"):
        calibrate(np.stack([images[7], untouched]), untouched, TRUE, RADIUS)


def test_photographs_that_cannot_be_used_are_named_and_others_used(tmp_path: Path) -> None:
    grey = np.full((8, 6, 3), 90, dtype=np.uint8)
    marked = grey.copy()
    marked[2, 2] = 120
    for name, picture in (("a.png", marked), ("b.png", grey[:4]), ("d.png", grey), ("untouched.png", grey)):
        Image.fromarray(picture).save(tmp_path / name)
    (tmp_path / "c.jpg").write_bytes(b"no picture")
    reading = read_photographs([tmp_path])
    assert reading.names == ["a.png"]
    assert len(reading.faults) == 3
    assert "b.png: 6 x 4 pixels, the untouched one has 6 x 8" in reading.faults[0]
    assert reading.faults[1].startswith("c.jpg: cannot be read")
    assert reading.faults[2] == "d.png: of one colour all over. Left out."
    with pytest.raises(InputError, match="elsewhere is not there"):
        read_photographs([tmp_path / "elsewhere"])
    (tmp_path / "untouched.png").unlink()
    with pytest.raises(InputError, match="no picture shows the untouched sensor"):
        read_photographs([tmp_path])


@pytest.mark.slow
def test_the_command_writes_a_sensor_that_is_read(
    with_markers, calibration, tmp_path: Path, capsys, monkeypatch
) -> None:
    images, untouched = with_markers
    markers = track_markers(images, untouched, TRUE)
    assert markers is not None
    calibration = replace(
        calibration, markers=markers, sensor=replace(calibration.sensor, marker_grid=markers.grid)
    )
    for index, picture in enumerate(images):
        Image.fromarray(picture).save(tmp_path / f"{index:02}.png")
    Image.fromarray(untouched).save(tmp_path / "background.png")
    mine = tmp_path / "mine.yaml"
    command = [str(tmp_path), "--ball", "8", "--sensor", "digit-tacto", "-o", str(mine)]

    def calibrate_once(*arguments: object) -> OwnCalibration:
        for part, expected in zip(arguments, (images, untouched, TRUE, RADIUS), strict=True):
            assert np.array_equal(part, expected)
        return calibration

    monkeypatch.setattr(own_calibration, "calibrate", calibrate_once)
    assert main(["calibrate", *command]) == 0
    said = capsys.readouterr().out
    assert "15 of 15 photographs used" in said
    assert "mine.yaml, mine.npy, mine-response.npy" in said
    assert "Expected error" in said
    assert ", 80 of 80 markers, moved by " in said
    assert "Markers: 10 x 8, 2.500 mm from row to row, 2.500 from column to column, turned by 2.0" in said
    assert "80 of 80 there, 4 um rms from the grid" in said
    sensor = read_sensor(mine)
    assert (sensor.name, sensor.image_height, sensor.gel_sagitta_m) == ("mine", 160, TRUE.gel_sagitta_m)
    assert sensor.photometric_table is not None
    assert sensor.indentation_response == calibration.sensor.indentation_response
    assert sensor.marker_grid == markers.grid
    assert main(["calibrate", *command, "--overwrite", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert len(content["psnr_db"]["held_out"]) == 7
    assert content["markers"]["dots"] == content["markers"]["followed"]["00.png"] == 80
    assert main(["calibrate", *command]) == 1
    assert "is there already" in capsys.readouterr().err
