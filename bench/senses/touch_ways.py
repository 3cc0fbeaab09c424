"""Seconds and errors of ways to draw a touch of one object, and what its stored surface costs and loses."""

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np

from bench.rivals.touch.networks import QUERY_FIELDS, RIVALS, fit_touch_network
from objectfolder.fidelity.feel import measure_feel
from objectfolder.making.touches.opengl import OpenGLRenderer
from objectfolder.making.touches.record import simulate_touches
from objectfolder.products.store import Product
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.presses.press import press
from objectfolder.touch.presses.touches import Press
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.touchnet import TouchNet

SAMPLES, TRUTH_SAMPLES = (1, 2, 3, 4), 8
SIZES = ((160, 120), (320, 240), (640, 480))
SIZED_SAMPLES = (1, 2)
ELASTIC_TOUCHES = 6
# Touches that were trained on, judged to tell learning from generalising.
SHOWN = 24
# Touches that judge a stored surface, and pairs that are timed.
ENCODED_TOUCHES, PAIRS = 24, 20
Row = dict[str, Any]


def measure_ways(options: argparse.Namespace, surface: Surface, name: str, networks: bool) -> Row:
    """Return an object's row.

    Parameters
    ----------
    options
        Settings of `bench.senses.touch`.
    networks
        Fit and measure the papers' networks, too.
    """
    sensor = Sensor()
    touches = simulate_touches(
        surface,
        sensor,
        touches=options.training_touches if networks else 1,
        held_out_touches=options.held_out_touches,
        samples=2,
        seed=0,
    )
    queries = {key: np.asarray(touches[key])[touches["held_out"]] for key in QUERY_FIELDS}
    start = time.process_time()
    patches = FacePatches(surface)
    press(patches, sensor, queries["points"][:1], Press(samples=1))
    prepared = time.process_time() - start
    truth = press(patches, sensor, *pressed(queries, TRUTH_SAMPLES))

    def error(images: np.ndarray) -> Row:
        return dict(measure_feel(truth.rgb, truth.mask, images, truth.mask))

    ways = {
        samples: lambda s=samples: press(patches, sensor, *pressed(queries, s)).rgb for samples in SAMPLES
    }
    seconds: dict[int, list[float]] = {samples: [] for samples in SAMPLES}
    images = {samples: way() for samples, way in ways.items()}
    opengl: list[float] = []
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        drawings = np.zeros_like(truth.rgb)
        for turn in range(options.rounds):
            shift = turn % len(SAMPLES)
            for samples in SAMPLES[shift:] + SAMPLES[:shift]:
                start = time.process_time()
                ways[samples]()
                seconds[samples].append((time.process_time() - start) / len(truth.rgb))
            task = pool.submit(by_opengl, surface.vertices, surface.faces, sensor, truth.sensor_to_object)
            drawings, spent = task.result()
            opengl.append(spent)
    rows = [
        {"way": "ours", "setting": samples, "cpu_s": float(np.median(seconds[samples]))}
        | error(images[samples])
        for samples in SAMPLES
    ]
    untouched = np.broadcast_to(no_contact_image(sensor, 2), truth.rgb.shape)
    rows += [
        {"way": "pyrender", "setting": None, "cpu_s": float(np.median(opengl))} | error(drawings),
        {"way": "no contact", "setting": None} | error(untouched),
    ]
    if networks:
        rows += [network_row(way, touches, queries, error, options.network_cpu_s) for way in RIVALS]
        mean = np.rint(touches["rgb"][~touches["held_out"]].mean(axis=0, dtype=np.float64))
        image = np.broadcast_to(mean.astype(np.uint8), truth.rgb.shape)
        rows.append({"way": "mean image", "setting": None, "bytes": image[0].nbytes} | error(image))
    return {
        "object": name,
        "faces": len(surface.faces),
        "set_up_cpu_s": prepared,
        "reachable": float(truth.reachable.mean()),
        "ways": rows,
        "sizes": sizes(patches, sensor, queries, options.rounds),
        "elastic_touches_a_cpu_s": elastic(patches, sensor, queries["points"]),
    }


def pressed(queries: Row, samples: int) -> tuple[np.ndarray, Press]:
    """Points, and how to press there."""
    settings = {name: values for name, values in queries.items() if name != "points"}
    return queries["points"], Press(**settings, samples=samples)


def network_row(
    way: str, touches: Product, queries: Row, error: Callable[[np.ndarray], Row], budget_cpu_s: float
) -> Row:
    """Fit a network of the papers for some CPU seconds, and measure it."""
    fitted = fit_touch_network(way, touches, budget_cpu_s=budget_cpu_s, seed=0)
    start = time.process_time()
    images = fitted.render(**queries)
    spent = (time.process_time() - start) / len(images)
    examples = np.flatnonzero(~touches["held_out"])[:SHOWN]
    answers = fitted.render(**{name: touches[name][examples] for name in queries})
    mask = touches["mask"][examples]
    return {
        "way": f"{way} network",
        "setting": None,
        "cpu_s": spent,
        "bytes": fitted.bytes,
        "training_cpu_s": fitted.training.cpu_s,
        "training_steps": fitted.training.steps,
        "psnr_contact_training_db": measure_feel(touches["rgb"][examples], mask, answers, mask)[
            "psnr_contact_db"
        ],
    } | error(images)


def sizes(patches: FacePatches, sensor: Sensor, queries: Row, rounds: int) -> list[Row]:
    """Touches a CPU second at three sizes of image."""
    rows = []
    for height, width in SIZES:
        sized = sensor.at_resolution(height, width)
        for samples in SIZED_SAMPLES:
            seconds = []
            for _ in range(rounds + 1):
                start = time.process_time()
                press(patches, sized, *pressed(queries, samples))
                seconds.append((time.process_time() - start) / len(queries["points"]))
            rate = 1 / float(np.median(seconds[1:]))
            rows.append({"height": height, "width": width, "samples": samples, "touches_a_cpu_s": rate})
    return rows


def elastic(patches: FacePatches, sensor: Sensor, points: np.ndarray) -> float:
    """Touches a CPU second of an elastic gel, half a millimetre deep; the first is not counted."""
    request = Press(depth_m=0.0005, contact="elastic")
    press(patches, sensor, points[:1], request)
    start = time.process_time()
    press(patches, sensor, points[:ELASTIC_TOUCHES], request)
    return ELASTIC_TOUCHES / (time.process_time() - start)


def by_opengl(
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


def measure_encoding(surface: Surface, name: str) -> dict[str, Any]:
    """Return the row of one object."""
    random = np.random.default_rng(1)
    azimuth = random.uniform(0, 360, ENCODED_TOUCHES)
    upright = {"depth_m": random.uniform(0.0005, 0.002, ENCODED_TOUCHES), "tilt_deg": 0.0}
    tilted = {"depth_m": 0.002, "tilt_deg": 15.0, "azimuth_deg": azimuth}
    turned = turned_off_the_grid(surface)
    net, size = stored(surface)
    turned_net, turned_size = stored(turned)
    first_ms, pair_ms = _pair_ms(net)
    return {
        "object": name,
        "faces": len(surface.faces),
        "bytes": size,
        "normal": _error(surface, net, upright),
        "tilted": _error(surface, net, tilted),
        "turned": _error(turned, turned_net, tilted),
        "turned_bytes": turned_size,
        "first_pair_ms": first_ms,
        "pair_ms": pair_ms,
    }


def stored(surface: Surface) -> tuple[TouchNet, int]:
    """Return touch by the surface as it is stored, and its bytes."""
    encoded = encode_surface(surface)
    return TouchNet(decode_surface(encoded), Sensor()), sum(array.nbytes for array in encoded.values())


def _error(surface: Surface, net: TouchNet, queries: dict[str, Any]) -> dict[str, Any]:
    """Measures of the stored surface against the source, pressed alike at points of the source."""
    points = surface.sample(ENCODED_TOUCHES, 1).points
    truth = press(surface, Sensor(), points, Press(samples=2, **queries))
    answer = net.press(points, Press(**queries))
    return dict(measure_feel(truth.rgb, truth.mask, answer.rgb, answer.mask))


def turned_off_the_grid(surface: Surface) -> Surface:
    """Turn a surface round an oblique axis, so that its coordinates are no whole micrometres any more."""
    axis, angle = np.array([1.0, 2.0, 3.0]) / np.sqrt(14), 1.0
    cross = np.cross(np.eye(3), axis)
    rotation = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return Surface(surface.vertices @ rotation.T, surface.faces)


def _pair_ms(net: TouchNet) -> tuple[float, float]:
    """CPU milliseconds of two touches as an open Object File makes them: of the first, and the median."""
    points = net.surface.sample(2 * (PAIRS + 1), 3).points.reshape(-1, 2, 3)
    seconds = []
    for pair in points:
        start = time.process_time()
        net.press(net.surface.closest_points(pair).points, Press(depth_m=np.array([0.001, 0.002])))
        seconds.append(time.process_time() - start)
    return 1e3 * seconds[0], 1e3 * float(np.median(seconds[1:]))
