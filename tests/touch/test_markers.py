"""Markers of a gel: where the camera sees them, what moves them, how they are drawn."""

from dataclasses import replace

import numpy as np
import pytest

from objectfolder.errors import QueryError
from objectfolder.touch.contact.height_field import gel_grid
from objectfolder.touch.elastic.contact_problem import Contact
from objectfolder.touch.elastic.markers import Markers, moved_markers
from objectfolder.touch.elastic.shear import Shear
from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.marker_grid import MarkerGrid
from objectfolder.touch.sensor.sensor import Sensor

CELLS = (48, 32)


def moved(down_m, right_m, inward_m=0.0, sensor=None, grid=None):
    """Markers of a gel that is displaced by fields over its cells."""
    nothing, none = np.zeros(CELLS), np.zeros(2)
    displacement = np.stack([np.broadcast_to(down_m, CELLS), np.broadcast_to(right_m, CELLS)])
    inward = np.broadcast_to(inward_m, CELLS)
    contact = Contact(nothing, inward, nothing, 0.0, (0.03 / 48, 0.02 / 32), 0.0, 0)
    shear = Shear(np.zeros((2, *CELLS)), displacement, none, nothing > 0, False, 0.0, 0)
    return moved_markers(sensor or Sensor(), contact, shear, grid)


def test_markers_at_rest_are_seen_where_the_cameras_rays_meet_the_gel():
    sensor = Sensor().at_resolution(64, 48)
    markers = moved(0.0, 0.0, sensor=sensor, grid=(64, 48))
    rays = ray_grid(sensor, 1)
    along = rays.gel_depth.reshape(64, 48)
    np.testing.assert_allclose(markers.rest_m[:, 0].reshape(64, 48), along, atol=1e-12)
    np.testing.assert_allclose(markers.rest_m[:, 1].reshape(64, 48), along * rays.u, atol=1e-12)
    np.testing.assert_allclose(
        markers.rest_m[:, 2].reshape(64, 48), 0.015 + along * rays.v[:, None], atol=1e-12
    )
    rows, columns = np.divmod(np.arange(64 * 48), 48)
    np.testing.assert_allclose(markers.pixels, np.stack([rows, columns], axis=1), atol=1e-9)


def test_a_gel_that_is_dragged_down_and_right_moves_its_markers_so_in_the_image():
    markers = moved(2e-4, 1e-4)
    np.testing.assert_allclose(
        markers.displacement_m, np.broadcast_to([0, -1e-4, -2e-4], (63, 3)), atol=1e-18
    )
    shift = markers.pixels - markers.rest_pixels
    # A pinhole: 160 pixels over 60 degrees, the gel as far as each marker lies.
    focal = 80 / np.tan(np.radians(30))
    np.testing.assert_allclose(shift[:, 0], focal * 2e-4 / markers.rest_m[:, 0], rtol=1e-9)
    np.testing.assert_allclose(shift[:, 1], focal * 1e-4 / markers.rest_m[:, 0], rtol=1e-9)


def test_a_gel_that_is_pressed_in_moves_its_markers_away_from_the_images_middle():
    markers = moved(0.0, 0.0, 1e-3)
    middle = np.array([79.5, 59.5])
    before, after = (np.hypot(*(p - middle).T) for p in (markers.rest_pixels, markers.pixels))
    far = before > 1
    assert (after[far] > before[far]).all()
    np.testing.assert_allclose(after[far] / before[far], (markers.rest_m / (markers.rest_m - 1e-3))[far, 0])


def test_markers_move_as_the_cells_they_lie_on():
    z, y = gel_grid(Sensor(), CELLS)
    markers = moved(0.01 * z[:, None], -0.02 * y)
    _, y, z = markers.rest_m.T
    np.testing.assert_allclose(markers.displacement_m[:, 2], -0.01 * z, atol=1e-12)
    np.testing.assert_allclose(markers.displacement_m[:, 1], 0.02 * y, atol=1e-12)


@pytest.mark.parametrize("place", [(20.0, 30.0), (20.3, 29.7), (20.5, 30.5)])
def test_a_dot_is_as_large_as_its_disc_and_where_its_marker_is(place):
    white = np.full((40, 60, 3), 255, dtype=np.uint8)
    dot = Markers(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 2)), np.array([place]))
    dark = 1 - dot.drawn_on(white, 3.0)[..., 0] / 255
    assert dark.sum() == pytest.approx(np.pi * 9, rel=0.02)
    rows, columns = np.mgrid[:40, :60]
    assert (dark * rows).sum() / dark.sum() == pytest.approx(place[0], abs=0.03)
    assert (dark * columns).sum() / dark.sum() == pytest.approx(place[1], abs=0.03)
    assert ((dark > 0.01) & (dark < 0.99)).any()


def test_dots_beyond_the_border_and_over_one_another_are_drawn_as_far_as_they_show():
    white = np.full((20, 30, 3), 200, dtype=np.uint8)
    places = np.array([[-1.0, 5.0], [19.5, 29.5], [-50.0, 3.0], [60.0, 90.0], [10.0, 10.0], [10.0, 10.0]])
    dots = Markers(np.zeros((6, 3)), np.zeros((6, 3)), places, places)
    image = dots.drawn_on(white, 2.0)
    assert (image[0, 5] < 200).all()
    assert (image[19, 29] == 0).all()
    dot_image = Markers(np.zeros((1, 3)), np.zeros((1, 3)), places[:1], places[4:5]).drawn_on(white, 2.0)
    np.testing.assert_array_equal(image[5:15, 5:15], dot_image[5:15, 5:15])
    assert (white == 200).all()


def test_no_markers_without_a_grid_and_no_dots_without_a_radius():
    for grid in ((0, 7), (9, 2.5), (9, 10**6)):
        with pytest.raises(QueryError, match=r"grid: .* whole number"):
            moved(0.0, 0.0, grid=grid)
    with pytest.raises(QueryError, match=r"radius_pixels: nan"):
        moved(0.0, 0.0).drawn_on(np.zeros((160, 120, 3), np.uint8), np.nan)


def test_a_sensors_own_grid_is_drawn_at_any_size_as_far_as_it_lies_on_the_gel():
    # 240 pixels over 60 degrees, 22 mm away: 9.45 a millimetre.
    grid = MarkerGrid(3, 5, 0.002, 0.001, 0.0, 0.001, 0.0, 0.0004)
    scale = 120 / np.tan(np.radians(30)) / 0.022
    sensor = replace(Sensor(), marker_grid=grid).at_resolution(240, 180)
    markers = moved(0.0, 0.0, sensor=sensor)
    rows, columns = np.meshgrid(0.001 + 0.002 * np.arange(-1, 2), 0.001 * np.arange(-2, 3), indexing="ij")
    expected = np.stack([119.5 + scale * rows.ravel(), 89.5 + scale * columns.ravel()], axis=1)
    np.testing.assert_allclose(markers.rest_pixels, expected)
    np.testing.assert_allclose(markers.pixels, expected)
    dark = 1 - markers.drawn_on(np.full((240, 180, 3), 255, np.uint8))[..., 0] / 255
    assert dark.sum() == pytest.approx(15 * np.pi * (scale * 0.0004) ** 2, rel=0.02)
    assert len(moved(0.0, 0.0, sensor=sensor, grid=(2, 2)).pixels) == 4
    # A quarter turn counterclockwise: rows lead to the right, columns upwards.
    turned = moved(0.0, 0.0, sensor=replace(sensor, marker_grid=replace(grid, rotation_deg=90.0)))
    step = (turned.pixels[5] - turned.pixels[0], turned.pixels[1] - turned.pixels[0])
    np.testing.assert_allclose(step, [[0, 0.002 * scale], [-0.001 * scale, 0]], atol=1e-9)
    wide = replace(
        sensor, gel_sagitta_m=0.0, marker_grid=MarkerGrid(3, 31, 0.002, 0.001, 0.0, 0.0, 0.0, 0.0004)
    )
    assert len(moved(0.0, 0.0, sensor=wide).pixels) == 3 * 19  # of a gel 20 mm wide
