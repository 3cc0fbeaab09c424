"""What an indentation changes beyond itself: by its definition, in pictures, and as photographs show it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from touch_shapes import sphere

from objectfolder.errors import FormatError, InputError
from objectfolder.surface.surface import Surface
from objectfolder.touch import Press, Sensor, press, read_sensor
from objectfolder.touch.rendering.surroundings import surroundings
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.indentation_response import (
    Cells,
    IndentationResponse,
    ResponseField,
    ResponseFit,
)
from objectfolder.touch.sensor.sensor_file import write_sensor

GELSIGHT = read_sensor("gelsight").at_resolution(80, 60)
BALL, TOP = Surface(*sphere(0.004, 3)), np.array([[0.0, 0.0, 0.004]])


def smooth_response(side: int = 17) -> IndentationResponse:
    down, across = np.mgrid[:side, :side] - side // 2
    bell = np.exp(-((down - 2) ** 2 + across**2) / 18)
    share = np.array([[-0.06, 0.012, 0.0], [0.03, 0.0, 0.018], [0.0, -0.009, 0.006]])
    return IndentationResponse((share[:, :, None, None] * bell).astype(np.float16))


def test_an_indented_cell_adds_its_pattern_round_it() -> None:
    response = smooth_response(5)
    depth = np.zeros((80, 60), dtype=np.float32)
    depth[20:22, 40:42] = 1e-3  # a cell of 2 x 2 pixels: row 10 of 40, column 20 of 30
    change = ResponseField(response, 80, 60).change(depth)
    cells = Cells.of(80, 60).mean(change)
    a, b = (20.5 / 30) * 2 - 1, (10.5 / 40) * 2 - 1
    expected = np.einsum("ctij,t->ijc", response.coefficients.astype(float), [1, a, b])
    around = np.zeros((40, 30, 3))
    around[8:13, 18:23] = expected
    # From cells to pixels and back: of each cell three quarters, and an eighth of each neighbour on an axis.
    blurred = 0.75 * around
    blurred[1:] += 0.125 * around[:-1]
    blurred[:-1] += 0.125 * around[1:]
    twice = 0.75 * blurred
    twice[:, 1:] += 0.125 * blurred[:, :-1]
    twice[:, :-1] += 0.125 * blurred[:, 1:]
    np.testing.assert_allclose(cells, twice, atol=1e-6)


def test_pictures_are_changed_beyond_the_contact_as_the_field_says() -> None:
    sensor = replace(GELSIGHT, indentation_response=smooth_response())
    grey = np.full((80, 60, 3), 120, dtype=np.uint8)
    row, column = np.mgrid[:80, :60]
    for down, across in ((30, 20), (2, 58)):  # a pattern that the border cuts
        depth = 1e-3 * np.maximum(1 - ((row - down) ** 2 + (column - across) ** 2) / 90, 0)
        picture, depth = grey.copy(), depth.astype(np.float32)
        around = surroundings(sensor)
        assert around is not None
        around.cast(picture, depth)
        field = ResponseField(smooth_response(), 80, 60).change(depth)
        expected = np.where(depth[..., None] == 0, np.clip(120 + 255 * field, 0, 255), 120)
        assert np.ptp(expected) > 30
        np.testing.assert_allclose(picture, expected, atol=0.501)
    assert surroundings(GELSIGHT) is None


def test_a_picture_of_any_size_has_the_same_response() -> None:
    small, large = (
        press(BALL, replace(GELSIGHT.at_resolution(*size), indentation_response=smooth_response()), TOP)
        for size in ((80, 60), (160, 120))
    )
    halved = large.rgb[0].reshape(80, 2, 60, 2, 3).mean(axis=(1, 3))
    without = press(BALL, GELSIGHT, TOP)
    changed = np.abs(without.rgb[0].astype(float) - small.rgb[0])[~small.mask[0]]
    assert changed.max() > 10
    far = ~without.mask[0]
    assert np.abs(halved - small.rgb[0])[far].mean() < 0.1 * changed.mean()


def test_a_bent_gel_shows_its_bulge_by_the_response_alone() -> None:
    nothing = IndentationResponse(np.zeros((3, 3, 3, 3), dtype=np.float16))
    sensor = replace(GELSIGHT, indentation_response=nothing)
    request = Press(force_n=1.0, samples=1)
    bent, bulging = (press(BALL, gel, TOP, request) for gel in (sensor, GELSIGHT))
    beside = ~bent.mask[0]
    untouched = no_contact_image(sensor)
    assert (bent.rgb[0][beside] == untouched[beside]).all()
    assert np.array_equal(bent.rgb[0][~beside], bulging.rgb[0][~beside])
    assert (bulging.rgb[0][beside] != untouched[beside]).any()


def test_a_response_is_found_in_what_it_changes() -> None:
    field = ResponseField(smooth_response(), 80, 60)
    row, column = np.mgrid[:80, :60]
    changes, pressed = {}, {}
    for index, (down, across) in enumerate([(20, 20), (30, 40), (55, 15), (60, 45), (40, 30)]):
        depth = 1e-3 * np.maximum(1 - ((row - down) ** 2 + (column - across) ** 2) / 64, 0)
        noise = np.random.default_rng(index).normal(0, 2, (80, 60, 3))
        # What the contact itself shows counts for nothing.
        changes[index] = np.where(depth[..., None] > 0, 99.0, 255 * field.change(depth) + noise)
        pressed[index] = depth
    response = ResponseFit(changes, pressed).solve([0, 1, 2, 3], 1e-2, 1.0)
    beyond = pressed[4] == 0
    exact, held_out = (fit.change(pressed[4])[beyond] for fit in (field, ResponseField(response, 80, 60)))
    assert np.abs(held_out - exact).max() < 0.15 * np.abs(exact).max()


def test_a_response_is_stored_with_its_sensor(tmp_path: Path) -> None:
    sensor = replace(GELSIGHT, name="mine", indentation_response=smooth_response())
    assert Sensor.from_dict(sensor.to_dict()) == sensor
    assert "indentation_response" not in GELSIGHT.to_dict()
    write_sensor(tmp_path / "mine.yaml", sensor, "A ball.")
    assert read_sensor(tmp_path / "mine.yaml").indentation_response == sensor.indentation_response
    (tmp_path / "mine-response.npy").unlink()
    with pytest.raises(InputError, match=r"mine-response\.npy: no indentation response"):
        read_sensor(tmp_path / "mine.yaml")
    stored = sensor.to_dict()
    for wrong in (None, {"shape": [3, 3, 2, 2], "float16": ""}, {"shape": [3, 3, 99, 99], "float16": "AAA="}):
        with pytest.raises(FormatError, match="indentation response"):
            Sensor.from_dict(stored | {"indentation_response": wrong})
    for bad in (np.zeros((3, 3, 4, 4), np.float16), np.full((3, 3, 3, 3), np.inf, np.float16)):
        with pytest.raises(ValueError, match="indentation response"):
            IndentationResponse(bad)
