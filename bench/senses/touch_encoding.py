"""What a stored surface costs, how its touches differ from the source's, and its latency."""

import time
from typing import Any

import numpy as np

from objectfolder.fidelity.feel import measure_feel
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.surface import Surface
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.touchnet import TouchNet
from objectfolder.touch.truth.press import press
from objectfolder.touch.truth.touches import Press

HELD_OUT = 24
PAIRS = 20


def measure_encoding(surface: Surface, name: str) -> dict[str, Any]:
    """Return the row of one object."""
    random = np.random.default_rng(1)
    azimuth = random.uniform(0, 360, HELD_OUT)
    upright = {"depth_m": random.uniform(0.0005, 0.002, HELD_OUT), "tilt_deg": 0.0}
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


def _error(surface: Surface, net: TouchNet, asked: dict[str, Any]) -> dict[str, Any]:
    """Measures of the stored surface against the source, pressed alike at points of the source."""
    points = surface.sample(HELD_OUT, 1).points
    truth = press(surface, Sensor(), points, Press(samples=2, **asked))
    answer = net.press(points, Press(**asked))
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
