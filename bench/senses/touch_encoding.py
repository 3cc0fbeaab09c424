"""What a stored surface costs, how its touches differ from the source's, what cannot be reached, latency."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.fidelity.feel import measure_feel
from objectfolder.object_file import ObjectFile
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.touchnet import TouchNet
from objectfolder.touch.truth.press import press
from objectfolder.touch.truth.touches import Press, Touches

HELD_OUT = 24
LABELLED = 200
PAIRS = 20
SLACK_M = 2.0**-23


def measure_encoding(surface: Surface, name: str) -> dict[str, Any]:
    """Return the row of one object."""
    sensor = Sensor()
    encoded = encode_surface(surface)
    net = TouchNet(decode_surface(encoded), sensor)
    patches = FacePatches(surface)
    random = np.random.default_rng(1)
    points = surface.sample(HELD_OUT, 1).points
    azimuth = random.uniform(0, 360, HELD_OUT)
    cases: dict[str, dict[str, Any]] = {
        "normal": {"depth_m": random.uniform(0.0005, 0.002, HELD_OUT), "tilt_deg": 0.0},
        "tilted": {"depth_m": 0.002, "tilt_deg": 15.0, "azimuth_deg": azimuth},
    }
    figures: dict[str, Any] = {}
    too_deep = 0
    for case, asked in cases.items():
        truth = press(patches, sensor, points, Press(samples=2, **asked))
        answer = net.press(points, Press(**asked))
        figures[case] = measure_feel(truth.rgb, truth.mask, answer.rgb, answer.mask)
        reachable = truth.reachable
        if reachable.any():
            figures[f"{case}_reachable"] = measure_feel(
                truth.rgb[reachable], truth.mask[reachable], answer.rgb[reachable], answer.mask[reachable]
            )
        figures[f"{case}_labels_differ"] = int((truth.reachable != answer.reachable).sum())
        figures[f"{case}_offset_difference_m"] = float(
            np.abs(truth.first_contact_offset_m - answer.first_contact_offset_m).max()
        )
        too_deep += _too_deep(truth) + _too_deep(answer)
    turned = turned_off_the_grid(surface)
    stored = encode_surface(turned)
    where = turned.sample(HELD_OUT, 1).points
    truth = press(turned, sensor, where, Press(samples=2, **cases["tilted"]))
    answer = TouchNet(decode_surface(stored), sensor).press(where, Press(**cases["tilted"]))
    figures["turned"] = measure_feel(truth.rgb, truth.mask, answer.rgb, answer.mask)
    figures["turned_bytes"] = sum(array.nbytes for array in stored.values())
    labelled = press(patches, sensor, surface.sample(LABELLED, 2).points, Press(depth_m=0.001, samples=1))
    too_deep += _too_deep(labelled)
    return {
        "object": name,
        "faces": len(surface.faces),
        "bytes": sum(array.nbytes for array in encoded.values()),
        "farthest_vertex_m": float(
            net.surface.closest_points(surface.vertices[surface.faces[:, 0]]).distance.max()
        ),
        **figures,
        "unreachable_share": 1 - float(labelled.reachable.mean()),
        "blocked_more_than_0.1_mm_share": float((labelled.first_contact_offset_m > 1e-4).mean()),
        "blocked_more_than_1_mm_share": float((labelled.first_contact_offset_m > 1e-3).mean()),
        "images_deeper_than_their_label": too_deep,
        "pair_ms": _pair_ms(net),
    }


def turned_off_the_grid(surface: Surface) -> Surface:
    """Turn a surface round an oblique axis, so that its coordinates are no whole micrometres any more."""
    axis, angle = np.array([1.0, 2.0, 3.0]) / np.sqrt(14), 1.0
    cross = np.cross(np.eye(3), axis)
    rotation = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return Surface(surface.vertices @ rotation.T, surface.faces)


def _too_deep(touches: Touches) -> int:
    """Images that show the object deeper in the gel than `penetration_m` says."""
    deepest = touches.depth.reshape(len(touches), -1).max(axis=1)
    return int((deepest > touches.penetration_m + SLACK_M).sum())


def _pair_ms(net: TouchNet) -> float:
    """Median CPU milliseconds of two touches as an open Object File makes them, from points near it."""
    points = net.surface.sample(2 * (PAIRS + 1), 3).points.reshape(-1, 2, 3)
    seconds = []
    for pair in points:
        start = time.process_time()
        net.press(net.surface.closest_points(pair).points, Press(depth_m=np.array([0.001, 0.002])))
        seconds.append(time.process_time() - start)
    return 1e3 * float(np.median(seconds[1:]))


def measure_object_file(path: Path) -> dict[str, Any]:
    """Milliseconds to open a finished Object File and touch it, and for each pair of touches after."""
    start = time.process_time()
    found = ObjectFile.load(path)
    opened = time.process_time() - start
    points = found.sample_contacts(2 * (PAIRS + 1), 3)[0].reshape(-1, 2, 3)
    seconds = []
    for pair in points:
        start = time.process_time()
        found.press(pair, np.array([0.001, 0.002]))
        seconds.append(time.process_time() - start)
    return {
        "file": path.name,
        "open_ms": 1e3 * opened,
        "first_pair_ms": 1e3 * seconds[0],
        "pair_ms": 1e3 * float(np.median(seconds[1:])),
    }
