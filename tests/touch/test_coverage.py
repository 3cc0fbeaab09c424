"""Rays that find what covers a pixel: where they lie, how finely they resolve edges, where shading is."""

from typing import Any

import numpy as np
import pytest

from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.press import render_poses
from objectfolder.touch.sensor.camera import coverage_grid, ray_grid
from objectfolder.touch.sensor.sensor import Sensor

SENSOR = Sensor(image_height=40, image_width=30)
PITCH = float(2 * np.tan(np.pi / 6) / 40)


def places(samples: int) -> np.ndarray:
    """Right and down (rays, 2), in pixels, of the rays of one pixel from its corner."""
    grid = coverage_grid(SENSOR, samples)
    rows = np.arange(7 * samples**2, 8 * samples**2)
    right = 15 - (grid.u[11] + grid.shift[rows]) / PITCH - 11
    down = 20 - grid.v[rows] / PITCH - 7
    return np.stack([right, down], axis=1)


def sheet(left: float, right: float, x: float = 0.014) -> Surface:
    """A sheet across the sensor's view, from one y to another."""
    corners = [(x, left, -0.05), (x, right, -0.05), (x, left, 0.1), (x, right, 0.1)]
    return Surface(np.array(corners), np.array([[0, 2, 3], [0, 3, 1]]))


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_no_two_rays_of_a_pixel_share_a_row_or_a_column(samples: int) -> None:
    even = (np.arange(samples**2) + 0.5) / samples**2
    for axis in (0, 1):
        assert np.allclose(np.sort(places(samples)[:, axis]), even)
    # One in each of samples x samples cells, too.
    cells = np.floor(places(samples) * samples).astype(int)
    assert len({tuple(cell) for cell in cells}) == samples**2


def test_four_rays_lie_where_graphics_processors_put_them() -> None:
    # Direct3D's standard pattern of four, in sixteenths of a pixel from its middle, up to a mirror image.
    standard = np.array([(-2, -6), (6, -2), (-6, 2), (2, 6)]) / 16 + 0.5
    mirrored = np.stack([1 - standard[:, 0], standard[:, 1]], axis=1)
    offsets = {tuple(np.round(place, 9)) for place in places(2)}
    assert offsets == {tuple(np.round(place, 9)) for place in mirrored}


def test_one_ray_a_pixel_passes_through_its_middle() -> None:
    grid, even = coverage_grid(SENSOR, 1), ray_grid(SENSOR, 1)
    assert np.allclose(grid.u, even.u)
    assert np.allclose(grid.v, even.v)
    assert (grid.shift == 0).all()
    assert np.allclose(grid.gel_depth, even.gel_depth)
    assert np.array_equal(grid.gel_values, even.gel_values)


@pytest.mark.parametrize("samples", [2, 3])
def test_edges_along_the_image_are_resolved_to_one_ray_of_all(samples: int) -> None:
    # A sheet whose edge runs up the image: what is seen of it grows in steps of one ray a pixel, where an
    # even grid's would be those of a column of rays.
    errors = []
    for edge in np.linspace(-0.0004, 0.0004, 41):
        image = render_poses(sheet(-0.05, edge), SENSOR, np.eye(4)[None], samples)[0]
        width = image.contact_area_m2 / (40 * PITCH * 0.014)
        errors.append((width - (edge + 15 * PITCH * 0.014)) / (PITCH * 0.014))
    assert np.abs(errors).max() <= 0.5 / samples**2 + 1e-6
    assert np.ptp(errors) > 0.5 / samples**2


def test_a_face_is_shaded_at_the_middle_of_the_pixels_it_fills() -> None:
    slab = sheet(-0.05, 0.05)
    pose: Any = np.eye(4)[None]
    coarse, two, four = (render_poses(slab, SENSOR, pose, samples)[0] for samples in (1, 2, 4))
    # But along the sheet's diagonal, two faces a pixel have two middles.
    for finer in (two, four):
        difference = np.abs(finer.rgb.astype(int) - coarse.rgb)
        assert difference.max() <= 1
        assert (difference > 0).mean() < 0.02
