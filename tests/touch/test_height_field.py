import numpy as np
import pytest
from touch_shapes import box, bumpy, joined, mug, sphere

from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.height_field import REACH_M, gap_field, gel_grid
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.presses.press import press
from objectfolder.touch.presses.touches import Press
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor

SENSOR = Sensor()
SHAPE = (48, 32)


def centres() -> tuple[np.ndarray, np.ndarray]:
    z, y = gel_grid(SENSOR, SHAPE)
    yy, zz = np.meshgrid(y, z)
    return yy, zz


def test_the_grid_covers_the_gel_from_its_top_left_as_images_do() -> None:
    z, y = gel_grid(SENSOR, SHAPE)
    assert z[0] + z[-1] == pytest.approx(0.03)
    assert y[0] + y[-1] == pytest.approx(0.0)
    assert z[0] - z[1] == pytest.approx(0.03 / 48)
    assert y[0] - y[1] == pytest.approx(0.02 / 32)


def test_the_height_of_a_plane_over_the_gel_is_its_distance_less_the_sag() -> None:
    plane = FacePatches(Surface(*box((0.021, -1, -1), (0.1, 1, 1))))
    y, z = centres()
    gap = gap_field(plane, SENSOR, np.eye(4), SHAPE)
    assert np.abs(gap - (0.021 - gel_surface(SENSOR, y, z))).max() < 1e-12


def test_the_height_of_a_ball_is_the_closed_forms_and_infinite_beside_it() -> None:
    radius = 0.006
    vertices, faces = sphere(radius, 5)
    ball = FacePatches(Surface(vertices + np.array([0.021 + radius, 0.0, 0.015]), faces))
    y, z = centres()
    squared = y**2 + (z - 0.015) ** 2
    gap = gap_field(ball, SENSOR, np.eye(4), SHAPE)
    over = squared < (0.9 * radius) ** 2
    x = 0.021 + radius - np.sqrt(radius**2 - squared[over])
    assert np.abs(gap[over] - (x - gel_surface(SENSOR, y[over], z[over]))).max() < 2e-5
    assert np.isinf(gap[squared > radius**2]).all()


@pytest.mark.parametrize("name", ["bumpy ball", "mug", "crossed blades"])
def test_heights_are_those_of_rays_along_the_axis(name: str) -> None:
    surface = {
        "bumpy ball": bumpy(subdivisions=4),
        "mug": Surface(*mug()),
        "crossed blades": Surface(
            *joined(box((0, -0.006, 0), (0.12, 0.006, 0.002)), box((0, -0.006, 0.003), (0.06, 0.006, 0.005)))
        ),
    }[name]
    patches = FacePatches(surface)
    touch = press(
        patches, SENSOR, surface.sample(3, 4).points, Press(tilt_deg=12.0, azimuth_deg=30.0, samples=1)
    )
    y, z = centres()
    start = np.stack([np.full(y.size, 0.001), y.ravel(), z.ravel()], axis=1)
    for pose in touch.sensor_to_object:
        origins = start @ pose[:3, :3].T + pose[:3, 3]
        hits = surface.ray_hits(origins, np.broadcast_to(pose[:3, 0], origins.shape))
        expected = np.where(hits.distance + 0.001 <= 0.022 + REACH_M, hits.distance + 0.001, np.inf)
        expected = expected.reshape(SHAPE) - gel_surface(SENSOR, y, z)
        gap = gap_field(patches, SENSOR, pose, SHAPE)
        met = np.isfinite(gap) & np.isfinite(expected)
        assert (np.isfinite(gap) != np.isfinite(expected)).mean() < 2e-3
        assert np.abs(gap[met] - expected[met]).max() < 1e-9


def test_the_lowest_gap_is_the_penetration_to_within_a_cell() -> None:
    surface = bumpy()
    patches = FacePatches(surface)
    touch = press(patches, SENSOR, surface.sample(4, 2).points, Press(depth_m=0.0015, samples=1))
    for pose in touch.sensor_to_object:
        lowest = gap_field(patches, SENSOR, pose, (192, 128)).min()
        assert -0.0015 - 1e-9 <= lowest < -0.0014


def test_what_is_behind_the_camera_does_not_count() -> None:
    shelf = FacePatches(Surface(*box((-0.02, -1, -1), (-0.01, 1, 1))))
    assert np.isinf(gap_field(shelf, SENSOR, np.eye(4), SHAPE)).all()
