"""Seconds and errors of ways to draw a touch, on held-out touches of one object."""

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np

from bench.senses.touch_networks import NetworkRows, press_query
from objectfolder.fidelity.feel import measure_feel
from objectfolder.products.store import Product
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.truth.opengl import OpenGLRenderer
from objectfolder.touch.truth.press import press
from objectfolder.touch.truth.record import simulate_touches
from objectfolder.touch.truth.touches import Press

SAMPLES = (1, 2, 3, 4)
TRUTH_SAMPLES = 8
SIZES = ((160, 120), (320, 240), (640, 480))
SIZED_SAMPLES = (1, 2)
ELASTIC_TOUCHES = 6

Way = Callable[[], np.ndarray]


class Speed:
    """One object.

    Parameters
    ----------
    given
        Settings of `bench.senses.touch`.
    name
        Of the object.
    networks
        Fit and measure the papers' networks too.
    """

    def __init__(self, given: argparse.Namespace, name: str, networks: bool) -> None:
        self.given, self.name, self.networks = given, name, networks
        self.sensor = Sensor()

    def measure(self, surface: Surface) -> dict[str, Any]:
        """Return the object's row."""
        touches = simulate_touches(
            surface,
            self.sensor,
            touches=self.given.training_touches if self.networks else 1,
            held_out_touches=self.given.held_out_touches,
            samples=2,
            seed=0,
        )
        start = time.process_time()
        patches = FacePatches(surface)
        asked = _held_out(touches)
        press(patches, self.sensor, asked["points"][:1], Press(samples=1))
        prepared = time.process_time() - start
        truth = press(patches, self.sensor, *press_query(asked, TRUTH_SAMPLES))
        poses = truth.sensor_to_object

        def error(images: np.ndarray) -> dict[str, Any]:
            return measure_feel(truth.rgb, truth.mask, images, truth.mask)

        ways: dict[tuple[str, int | None], Way] = {
            ("ours", samples): lambda s=samples: press(patches, self.sensor, *press_query(asked, s)).rgb
            for samples in SAMPLES
        }
        seconds: dict[tuple[str, int | None], list[float]] = {key: [] for key in ways}
        images = {key: way() for key, way in ways.items()}
        opengl: list[float] = []
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            drawn = np.zeros_like(truth.rgb)
            for turn in range(self.given.rounds):
                keys = list(ways)
                for key in keys[turn % len(keys) :] + keys[: turn % len(keys)]:
                    start = time.process_time()
                    ways[key]()
                    seconds[key].append((time.process_time() - start) / len(poses))
                drawn, spent = pool.submit(
                    _by_opengl, surface.vertices, surface.faces, self.sensor, poses
                ).result()
                opengl.append(spent)
        rows = [
            {"way": way, "setting": setting, "cpu_s": float(np.median(seconds[way, setting]))}
            | error(images[way, setting])
            for way, setting in ways
        ]
        rows.append({"way": "pyrender", "setting": None, "cpu_s": float(np.median(opengl))} | error(drawn))
        untouched = np.broadcast_to(no_contact_image(self.sensor, 2), truth.rgb.shape)
        rows.append({"way": "no contact", "setting": None} | error(untouched))
        if self.networks:
            rows += NetworkRows(touches, asked, error).rows(self.given.network_cpu_s)
        return {
            "object": self.name,
            "faces": len(surface.faces),
            "set_up_cpu_s": prepared,
            "reachable": float(truth.reachable.mean()),
            "ways": rows,
            "sizes": self._sizes(patches, asked),
            "elastic_touches_a_cpu_s": self._elastic(patches, asked["points"]),
        }

    def _sizes(self, patches: FacePatches, asked: dict[str, Any]) -> list[dict[str, Any]]:
        """Touches a CPU second at three sizes of image."""
        rows = []
        for height, width in SIZES:
            sensor = self.sensor.at_resolution(height, width)
            for samples in SIZED_SAMPLES:
                seconds = []
                for turn in range(self.given.rounds + 1):
                    start = time.process_time()
                    press(patches, sensor, *press_query(asked, samples))
                    if turn:
                        seconds.append((time.process_time() - start) / len(asked["points"]))
                rate = 1 / float(np.median(seconds))
                rows.append({"height": height, "width": width, "samples": samples, "touches_a_cpu_s": rate})
        return rows

    def _elastic(self, patches: FacePatches, points: np.ndarray) -> float:
        """Touches a CPU second of an elastic gel, half a millimetre deep; the first is not counted."""
        pressed = Press(depth_m=0.0005, contact="elastic")
        press(patches, self.sensor, points[:1], pressed)
        start = time.process_time()
        press(patches, self.sensor, points[:ELASTIC_TOUCHES], pressed)
        return ELASTIC_TOUCHES / (time.process_time() - start)


def _held_out(touches: Product) -> dict[str, Any]:
    """Points of the held-out touches, and what `Press` takes."""
    chosen = touches["held_out"]
    return {
        name: np.asarray(touches[name])[chosen] for name in ("points", "depth_m", "tilt_deg", "azimuth_deg")
    }


def _by_opengl(
    vertices: np.ndarray, faces: np.ndarray, sensor: Sensor, poses: np.ndarray
) -> tuple[np.ndarray, float]:
    """Images of poses by pyrender in a process of its own, and CPU seconds of one, the first left out."""
    renderer = OpenGLRenderer(sensor)
    surface = Surface(vertices, faces)
    try:
        list(renderer.render(surface, poses[:1]))
        start = time.process_time()
        images = np.stack([image for image, _ in renderer.render(surface, poses)])
        spent = (time.process_time() - start) / len(poses)
    finally:
        renderer.close()
    return images, spent
