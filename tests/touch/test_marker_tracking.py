"""Grids of markers are found in drawn pictures whose grids are known, and their dots are followed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from objectfolder.errors import InputError
from objectfolder.touch.elastic.markers import Markers
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.magnification import pixels_per_metre
from objectfolder.touch.sensor.marker_grid import MarkerGrid
from objectfolder.touch.sensor.marker_tracking import track_markers, without_dots
from objectfolder.touch.sensor.sensor_file import read_sensor

SENSOR = read_sensor("gelsight")
SCALE = pixels_per_metre(SENSOR)
GEL = no_contact_image(SENSOR)
SHAPE = np.array(GEL.shape[:2])
GRID = MarkerGrid(7, 9, 1.4e-3, 1.6e-3, 3.0, 2e-4, -3e-4, 3e-4)


def pixels_of(grid: MarkerGrid) -> np.ndarray:
    return (SHAPE - 1) / 2 + grid.places_m() * SCALE


def drawn(places: np.ndarray, radius_m: float = GRID.dot_radius_m, noise: float = 2.0, seed: int = 0):
    """A gel in uneven light, the right side half as bright, with dots and the camera's noise."""
    random = np.random.default_rng(seed)
    light = GEL * np.linspace(1, 0.5, GEL.shape[1])[:, None]
    nothing = np.zeros((len(places), 3))
    dots = Markers(nothing, nothing, places, places, radius_m * SCALE).drawn_on(light)
    return np.clip(dots + 10 + random.normal(0, noise, GEL.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("grid", "noise", "missing", "dust"),
    [
        (GRID, 0.0, 0.0, 0),
        (GRID, 2.0, 0.15, 5),
        (replace(GRID, rows=5, columns=6, rotation_deg=-20.0), 2.0, 0.1, 0),
        (MarkerGrid(4, 6, 2.8e-3, 2.1e-3, 0.0, 0.0, 0.0, 5e-4), 2.0, 0.0, 0),
        (MarkerGrid(14, 19, 1e-3, 1e-3, 1.0, 0.0, 0.0, 2e-4), 5.0, 0.3, 0),
    ],
)
def test_a_drawn_grid_is_found(grid: MarkerGrid, noise: float, missing: float, dust: int) -> None:
    random = np.random.default_rng(1)
    places = pixels_of(grid)
    corners = np.isin(
        np.arange(len(places)), [0, grid.columns - 1, len(places) - grid.columns, len(places) - 1]
    )
    dots = places[corners | (random.random(len(places)) >= missing)]
    specks = np.array([(5.0, 5.0), (9.0, 200.0), (230.0, 15.0), (233.0, 301.0), (9.0, 309.0)])[:dust]
    picture = drawn(np.concatenate([dots, specks]), grid.dot_radius_m, noise)
    tracking = track_markers(picture[None], picture, SENSOR)
    assert tracking is not None
    assert (tracking.grid.rows, tracking.grid.columns) == (grid.rows, grid.columns)
    tolerance = dict.fromkeys(("row_pitch_m", "column_pitch_m"), 1e-6)
    tolerance |= dict.fromkeys(("offset_down_m", "offset_right_m"), 3e-6)
    for name, error in {**tolerance, "rotation_deg": 0.02, "dot_radius_m": 2e-5}.items():
        assert getattr(tracking.grid, name) == pytest.approx(getattr(grid, name), abs=error), name
    assert len(tracking.rest_pixels) == len(dots)
    assert cKDTree(dots).query(tracking.rest_pixels)[0].max() < 0.3
    assert tracking.rms_m * SCALE < 0.1
    assert tracking.followed.tolist() == [len(dots)]


def test_dots_are_followed_where_they_move_and_lost_ones_are_counted() -> None:
    places = pixels_of(GRID)
    away = places - (SHAPE / 2 + 3)
    spread = 6 * away / np.maximum(np.hypot(*away.T), 10)[:, None]
    gone = np.arange(len(places)) % 9 < 4
    photographs = np.stack([drawn(places + spread, seed=1), drawn(places[~gone], seed=2)])
    tracking = track_markers(photographs, drawn(places), SENSOR)
    assert tracking is not None
    assert tracking.followed.tolist() == [63, 35]
    assert tracking.fault(0) == ""
    assert tracking.fault(1) == "35 of 63 markers followed"
    shift = (tracking.pixels[0] - tracking.rest_pixels)[
        np.argsort(cKDTree(places).query(tracking.rest_pixels)[1])
    ]
    np.testing.assert_allclose(shift, spread, atol=0.3)
    assert tracking.largest_shift_m[0] * SCALE == pytest.approx(np.hypot(*spread.T).max(), abs=0.3)


def test_what_dots_hide_is_filled_from_about_them() -> None:
    # Of the outermost columns the picture shows but the rims.
    grid = replace(GRID, columns=14, rotation_deg=0.0, offset_right_m=0.0)
    picture = drawn(pixels_of(grid), noise=0.0)
    tracking = track_markers(picture[None], picture, SENSOR)
    assert tracking is not None
    clean = drawn(np.zeros((0, 2)), noise=0.0)
    error = np.abs(without_dots(picture, tracking.rest_hidden).astype(int) - clean)
    assert error.max() <= 5
    assert np.abs(picture.astype(int) - clean).max() > 50
    assert tracking.rest_hidden.mean() < 0.4


def test_dots_in_no_grid_and_no_dots_are_no_markers() -> None:
    random = np.random.default_rng(3)
    scattered = 10 + random.random((60, 2)) * (SHAPE - 20)
    turn = np.radians(np.arange(40) * 25.0)
    spiral = SHAPE / 2 + (10 + 2.5 * np.arange(40))[:, None] * np.stack([np.sin(turn), np.cos(turn)], axis=1)
    for places in (np.zeros((0, 2)), scattered, spiral, pixels_of(replace(GRID, rows=2, columns=4))):
        picture = drawn(places)
        assert track_markers(picture[None], picture, SENSOR) is None
    with pytest.raises(InputError, match="the untouched picture none"):
        track_markers(drawn(pixels_of(GRID))[None], drawn(scattered[:0]), SENSOR)
