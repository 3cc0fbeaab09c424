"""The renderer against OpenGL. Needs EGL (libegl1 and Mesa): without it these fail, and say so."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from touch_shapes import box, bumpy, psnr_db, torus

from bench.references.touch_opengl import render_reference
from objectfolder.surface.surface import Surface
from objectfolder.touch.sensor.camera import no_contact_image, ray_grid
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.truth.press import press
from objectfolder.touch.truth.touches import Press

SENSOR = Sensor()
SURFACES = {
    "bumpy ball": bumpy(),
    "torus": Surface(*torus()),
    "box": Surface(*box((0, 0, 0), (0.05, 0.04, 0.03))),
}


def reference(surface: Surface, poses: np.ndarray, held: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Images and camera depths from a process of its own: OpenGL and forks do not go together."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        done = pool.submit(render_reference, surface.vertices, surface.faces, SENSOR, poses, held)
        return done.result()


@pytest.mark.parametrize(
    "name",
    [
        "box",
        *(
            pytest.param(name, marks=pytest.mark.release("objectfolder.touch"))
            for name in ("bumpy ball", "torus")
        ),
    ],
)
def test_images_agree_with_opengl(name: str) -> None:
    surface = SURFACES[name]
    points = surface.sample(6, 2).points
    if name == "box":
        points = np.concatenate([points, surface.vertices[[7]], [[0.05, 0.02, 0.03]]])
    touch = press(surface, SENSOR, points, Press(depth_m=0.0012, tilt_deg=7.0, azimuth_deg=40.0))
    images, depths = reference(surface, touch.sensor_to_object)
    background = no_contact_image(SENSOR)
    seen = touch.mask.sum(axis=(1, 2)) > 100
    assert seen.sum() >= 5
    for index in np.flatnonzero(seen):
        # The same rays find what covers a pixel; OpenGL shades at its middle where a face fills a part, too.
        assert psnr_db(images[index], touch.rgb[index]) > 53
        assert psnr_db(images[index], background) < psnr_db(images[index], touch.rgb[index]) - 8
        inner = eroded(touch.mask[index])
        if name != "box":
            assert psnr_db(images[index], touch.rgb[index], inner) > 62
        indentation = indentation_of(depths[index])
        # OpenGL's depth is that of a sample up to 0.4 pixels off the centre.
        around = np.stack(
            [np.roll(touch.depth_m[index], (i - 1, j - 1), (0, 1)) for i, j in np.ndindex(3, 3)]
        )[:, inner]
        slack = 2e-4 if name == "box" else 3e-5
        assert (indentation[inner] < around.max(axis=0) + slack).all()
        assert (indentation[inner] > around.min(axis=0) - slack).all()


def test_the_untouched_gel_agrees_with_opengl_to_a_grey_level() -> None:
    pose = np.eye(4)
    pose[0, 3] = -1.0
    images, _ = reference(SURFACES["box"], pose[None])
    assert np.abs(images[0].astype(int) - no_contact_image(SENSOR)).max() <= 1


@pytest.mark.release("bench")
def test_a_mesh_held_by_opengl_looks_as_one_handed_over_at_each_pose() -> None:
    surface = SURFACES["bumpy ball"]
    touch = press(surface, SENSOR, surface.sample(3, 4).points, Press(depth_m=0.001))
    images, depths = reference(surface, touch.sensor_to_object)
    held_images, held_depths = reference(surface, touch.sensor_to_object, held=True)
    # Single precision moves outlines by a fraction of a micrometre.
    assert (np.abs(held_images.astype(int) - images) > 2).mean() < 2e-3
    assert np.median(np.abs(held_depths - depths)[touch.mask]) < 1e-6
    assert not np.array_equal(held_images[0], held_images[1])


def eroded(mask: np.ndarray) -> np.ndarray:
    inner = mask.copy()
    for axis in (0, 1):
        for step in (-2, -1, 1, 2):
            inner &= np.roll(mask, step, axis)
    return inner


def indentation_of(camera_depth: np.ndarray) -> np.ndarray:
    grid = ray_grid(SENSOR, 1)
    x = camera_depth.astype(np.float64)
    return gel_surface(SENSOR, grid.u * x, 0.015 + grid.v[:, None] * x) - x
