"""Touch: seconds against error of the renderer and its rivals, and what stored surfaces cost and lose.

    python -m bench touch --folder FOLDER [--objects CATALOGUE.csv]

Rows that are finished are kept in FOLDER and not made again: delete ``*.json`` there to measure again. Speeds
are touches a CPU second with their set-up (boxes over the faces, compilation) left out and stated beside
them. The comparison with TACTO itself is `bench.senses.touch_tacto`.
"""

import argparse
import json
import os
from typing import Any

import numpy as np

from bench.record import conclude, kept
from bench.senses.catalogue import VARIED, Scans, scan_arguments

# A smooth body, a tool with a head and a handle, a figure with thin parts.
SPEED_OBJECTS = ("011_banana", "048_hammer", "Schleich_African_Black_Rhino")
MEASURES = (
    "cpu_s", "psnr_db", "psnr_contact_db", "psnr_contact_worst_db", "ssim", "bytes", "training_cpu_s",
    "training_steps", "psnr_contact_training_db",
)  # fmt: skip
COMPARED = (
    "Touches of a DIGIT: this renderer over samples, pyrender, the papers' networks, "
    "mean image, no contact: CPU seconds, PSNR in the contact region against 8 x 8 samples; "
    "stored surfaces by bytes and PSNR against the source mesh pressed alike"
)
Row = dict[str, Any]


def main() -> None:
    parser = scan_arguments("touch: seconds, error and bytes", "rows")
    parser.add_argument("--speed-objects", nargs="+", default=list(SPEED_OBJECTS))
    parser.add_argument("--encoded-objects", nargs="+", default=list(VARIED))
    parser.add_argument("--network-objects", type=int, default=1, help="for how many of the speed objects")
    parser.add_argument("--network-cpu-s", type=float, default=60.0, help="training of each network")
    parser.add_argument("--training-touches", type=int, default=300)
    parser.add_argument("--held-out-touches", type=int, default=24)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    scans = Scans(given.objects)
    os.environ["NUMBA_NUM_THREADS"] = "1"
    import torch

    torch.set_num_threads(1)
    from bench.senses.touch_encoding import measure_encoding
    from bench.senses.touch_speed import Speed

    speed = []
    for index, name in enumerate(given.speed_objects):
        measure = Speed(given, name, networks=index < given.network_objects).measure
        speed.append(
            kept(given.folder / f"{name}.speed.json", lambda run=measure, at=name: run(scans.surface(at)))
        )
    encoded = [
        kept(
            given.folder / f"{name}.encoding.json",
            lambda at=name: measure_encoding(scans.surface(at), at),
        )
        for name in given.encoded_objects
    ]
    figures = {"summary": summarised(speed, encoded), "rows": {"speed": speed, "encoding": encoded}}
    print(json.dumps(figures["summary"], indent=1))
    conclude("touch", figures, _settings(given), COMPARED)


def summarised(speed: list[Row], encoded: list[Row]) -> Row:
    """Means and medians over objects."""
    encoding: Row = {
        "objects": len(encoded),
        "median_bytes": float(np.median([row["bytes"] for row in encoded])),
        "largest_bytes": max(row["bytes"] for row in encoded),
        "turned_median_bytes": float(np.median([row["turned_bytes"] for row in encoded])),
        "pair_ms_median": float(np.median([row["pair_ms"] for row in encoded])),
        "first_pair_ms_median": float(np.median([row["first_pair_ms"] for row in encoded])),
        "pair_ms_worst": max(row["pair_ms"] for row in encoded),
    }
    for case in ("normal", "tilted", "turned"):
        values = [row[case]["psnr_contact_db"] for row in encoded if row[case]["psnr_contact_db"] is not None]
        encoding[f"{case}_contact_psnr_db"] = float(np.mean(values))
        encoding[f"{case}_contact_psnr_worst_object_db"] = float(np.min(values))
    return {
        "ways": _ways(speed),
        "times_faster_than_pyrender": _times(speed, "pyrender"),
        "sizes": _sizes(speed),
        "elastic_touches_a_cpu_s": float(np.median([row["elastic_touches_a_cpu_s"] for row in speed])),
        "encoding": encoding,
    }


def _ways(speed: list[Row]) -> list[Row]:
    """Mean of each measure over the objects that have the way."""
    groups: dict[tuple[str, Any], list[Row]] = {}
    for row in speed:
        for way in row["ways"]:
            groups.setdefault((way["way"], way["setting"]), []).append(way)
    means = []
    for (name, setting), ways in groups.items():
        mean: Row = {"way": name, "setting": setting, "objects": len(ways)}
        for key in MEASURES:
            values = [way[key] for way in ways if way.get(key) is not None]
            if values:
                mean[key] = float(np.mean(values))
        means.append(mean)
    return means


def _times(speed: list[Row], rival: str) -> dict[str, float]:
    """How many times the seconds of each of our settings a rival takes, median over objects."""
    ratios: dict[str, list[float]] = {}
    for row in speed:
        slow = next(way["cpu_s"] for way in row["ways"] if way["way"] == rival)
        for way in row["ways"]:
            if way["way"] == "ours":
                ratios.setdefault(f"{way['setting']} x {way['setting']}", []).append(slow / way["cpu_s"])
    return {key: float(np.median(values)) for key, values in ratios.items()}


def _sizes(speed: list[Row]) -> list[Row]:
    """Touches a CPU second, median over objects, by height, width and samples."""
    return [
        {**sizes[0], "touches_a_cpu_s": float(np.median([size["touches_a_cpu_s"] for size in sizes]))}
        for sizes in zip(*(row["sizes"] for row in speed), strict=True)
    ]


def _settings(given: argparse.Namespace) -> Row:
    return {
        "speed_objects": given.speed_objects,
        "encoded_objects": given.encoded_objects,
        "touches": "points drawn evenly over the area, depth .5 to 2 mm, tilt up to 15 degrees",
        "held_out_touches": given.held_out_touches,
        "rounds": given.rounds,
        "times": "CPU seconds of one thread (pyrender: of its process with the driver's threads), medians "
        "over rounds that interleave the ways; RGB, depth and mask",
        "network_budget_cpu_s": given.network_cpu_s,
        "training_touches": given.training_touches,
        "encoding": "truth is the source mesh pressed at points drawn evenly over its area, the answer the "
        "stored surface pressed at the same points, depths and tilts; PSNR over pixels in contact in either, "
        "mean of touches, then of objects. Coordinates are stored to a micrometre, as most scans are "
        "written: where nothing is lost, images are equal. Turned: the same mesh turned round an oblique "
        "axis, so that its coordinates are no whole micrometres; 15 degrees, 2 mm",
        "psnr": "of 8-bit images, at most 58.9 dB a touch (rounding)",
    }
