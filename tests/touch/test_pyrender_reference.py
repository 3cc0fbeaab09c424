"""The compiled renderer against OpenGL's. Needs EGL (libegl1 and Mesa): without it these fail, and say so."""

import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from unittest import mock

import numpy as np
import pytest
from touch_shapes import box, bumpy, psnr_db, torus

from objectfolder.errors import InputError, MissingPackageError, SimulationError
from objectfolder.fidelity.feel import measure_renderers
from objectfolder.making.touches.opengl import OpenGLRenderer, check_drawable
from objectfolder.making.touches.record import simulate_touches
from objectfolder.products.store import Product
from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.press import press
from objectfolder.touch.presses.touches import Press
from objectfolder.touch.sensor.camera import no_contact_image, ray_grid
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.photometric_table import PhotometricTable
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.sensor_file import read_sensor

SLOW_FIXTURES = ("pool",)
SENSOR = Sensor()
PAINTED = replace(SENSOR, photometric_table=PhotometricTable(np.zeros((3, 2, 3, 6), np.float16)))
SURFACES = {
    "bumpy ball": bumpy(),
    "torus": Surface(*torus()),
    "box": Surface(*box((0, 0, 0), (0.05, 0.04, 0.03))),
}


@pytest.fixture(scope="module")
def pool() -> Iterator[ProcessPoolExecutor]:
    """A process of its own: OpenGL and forks do not go together."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        yield pool


def draw(vertices: np.ndarray, faces: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    renderer = OpenGLRenderer(SENSOR)
    images, depths = zip(*renderer.render(Surface(vertices, faces), poses), strict=True)
    renderer.close()
    return np.stack(images), np.stack(depths)


def reference(
    pool: ProcessPoolExecutor, surface: Surface, poses: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Images and camera depths."""
    return pool.submit(draw, surface.vertices, surface.faces, poses).result()


@pytest.mark.parametrize(
    "name",
    [
        "box",
        *(
            pytest.param(name, marks=pytest.mark.release("objectfolder.touch", "objectfolder.making.touches"))
            for name in ("bumpy ball", "torus")
        ),
    ],
)
def test_images_agree_with_opengl(pool: ProcessPoolExecutor, name: str) -> None:
    surface = SURFACES[name]
    points = surface.sample(6, 2).points
    if name == "box":
        points = np.concatenate([points, surface.vertices[[7]], [[0.05, 0.02, 0.03]]])
    touch = press(surface, SENSOR, points, Press(depth_m=0.0012, tilt_deg=7.0, azimuth_deg=40.0))
    images, depths = reference(pool, surface, touch.sensor_to_object)
    background = no_contact_image(SENSOR)
    visible = touch.mask.sum(axis=(1, 2)) > 100
    assert visible.sum() >= 5
    for index in np.flatnonzero(visible):
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


def test_the_untouched_gel_agrees_with_opengl_to_a_grey_level(pool: ProcessPoolExecutor) -> None:
    pose = np.eye(4)
    pose[0, 3] = -1.0
    images, _ = reference(pool, SURFACES["box"], pose[None])
    assert np.abs(images[0].astype(int) - no_contact_image(SENSOR)).max() <= 1


def simulate(renderer: str) -> Product:
    sensor = read_sensor("digit")  # shadows, and a gamma that is not pyrender's
    return simulate_touches(
        SURFACES["box"], sensor, touches=1, held_out_touches=3, tilt_deg=5.0, renderer=renderer, seed=3
    )


def test_a_data_set_by_pyrender_has_the_labels_of_the_compiled_and_its_own_images(
    pool: ProcessPoolExecutor,
) -> None:
    pyrender, compiled = pool.submit(simulate, "pyrender").result(), simulate("compiled")
    assert pyrender.attributes["renderer"]["name"] == "pyrender"
    assert pyrender.attributes["renderer"]["driver"]
    assert "renderer" not in compiled.attributes
    assert set(pyrender.arrays) - set(compiled.arrays) == {"compiled_rgb", "compiled_depth", "compiled_mask"}
    for name in compiled.arrays:
        same = np.array_equal(pyrender[name], compiled[name], equal_nan=name == "force_n")
        assert same == (name not in {"rgb", "depth", "mask", "no_contact"}), name
    for name in ("rgb", "depth", "mask"):
        assert np.array_equal(pyrender[f"compiled_{name}"], compiled[name][compiled["held_out"]])
    agreement = measure_renderers(pyrender)
    assert agreement["pyrender_psnr_contact_db"] > 45  # eight bits of one gamma turned into another: 50
    assert agreement["pyrender_mask_iou"] > 0.98
    assert agreement["pyrender_depth_rms_m"] < 2e-5
    assert psnr_db(pyrender["no_contact"], compiled["no_contact"]) > 48
    assert measure_renderers(compiled) == {}


def simulate_without_driver() -> None:
    with mock.patch.dict(os.environ, EGL_DEVICE_ID="99"):
        simulate("pyrender")


def test_a_machine_without_a_driver_or_pyrender_says_so_in_a_line(
    pool: ProcessPoolExecutor, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SimulationError, match=r"^pyrender: no OpenGL through EGL .*libegl1"):
        pool.submit(simulate_without_driver).result()
    monkeypatch.setitem(sys.modules, "pyrender", None)
    with pytest.raises(MissingPackageError, match=r"pyrender: .*objectfolder-factory\[opengl\]"):
        simulate("pyrender")


@pytest.mark.parametrize(
    ("renderer", "sensor", "contact", "message"),
    [
        ("opengl", SENSOR, "rigid", "renderer: 'opengl'. Use compiled or pyrender."),
        ("pyrender", SENSOR, "elastic", "renderer: pyrender draws no elastic contact"),
        ("pyrender", PAINTED, "rigid", "draws no photometric table, and DIGIT has one"),
    ],
)
def test_what_pyrender_cannot_draw_is_refused(
    renderer: str, sensor: Sensor, contact: str, message: str
) -> None:
    with pytest.raises(InputError) as raised:
        check_drawable(renderer, sensor, contact)
    assert message in str(raised.value)


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
