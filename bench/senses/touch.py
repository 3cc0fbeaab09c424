"""Touch: seconds against error of the renderer and its rivals, and what stored surfaces cost and lose.

    python -m bench touch --folder FOLDER [--objects CATALOGUE.csv]

Rows that are finished are kept in FOLDER and not made again: delete ``*.json`` there to measure again. Speeds
are touches a CPU second with their set-up (boxes over the faces, compilation) left out and stated beside
them. The comparison with TACTO itself is `bench.senses.touch_tacto`.
"""

import json
import os
from typing import Any

import numpy as np

from bench.record import conclude, rows_of, spread
from bench.senses.catalogue import Scans, scan_arguments, scan_set

# A smooth body, a tool with a head and a handle, a figure with thin parts.
SPEED_OBJECTS = ("011_banana", "048_hammer", "Schleich_African_Black_Rhino")
COMPARED = (
    "Touches of a DIGIT: this renderer over samples, pyrender, the papers' networks, mean image, no contact: "
    "CPU seconds, PSNR in the contact region against 8 x 8 samples; stored surfaces by bytes and PSNR "
    "against the source mesh pressed alike"
)
Row = dict[str, Any]


def main() -> None:
    parser = scan_arguments("touch: seconds, error and bytes", "rows")
    parser.add_argument("--speed-objects", nargs="+", default=list(SPEED_OBJECTS))
    parser.add_argument("--encoded-objects", nargs="+", default=list(scan_set("varied")))
    parser.add_argument("--network-objects", type=int, default=1, help="for how many of the speed objects")
    parser.add_argument("--network-cpu-s", type=float, default=60.0, help="training of each network")
    parser.add_argument("--training-touches", type=int, default=300)
    parser.add_argument("--held-out-touches", type=int, default=24)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    scans = Scans(options.objects)
    os.environ["NUMBA_NUM_THREADS"] = "1"
    import torch

    torch.set_num_threads(1)
    from bench.senses.touch_ways import measure_encoding, measure_ways

    fitted = options.speed_objects[: options.network_objects]
    speed = rows_of(
        options.speed_objects,
        lambda name: measure_ways(options, scans.surface(name), name, name in fitted),
        options.folder / "speed",
    )
    encoded = rows_of(
        options.encoded_objects,
        lambda name: measure_encoding(scans.surface(name), name),
        options.folder / "encoding",
    )
    rows = {"speed": list(speed.values()), "encoding": list(encoded.values())}
    figures = {"summary": summarised(**rows), "rows": rows}
    print(json.dumps(figures["summary"], indent=1))
    settings = {name: value for name, value in vars(options).items() if name not in ("folder", "objects")}
    conclude("touch", figures, settings | SETTINGS, COMPARED)


def summarised(speed: list[Row], encoding: list[Row]) -> Row:
    """Means and medians over objects."""
    surfaces: Row = {
        key: spread(encoding, key, max) for key in ("bytes", "turned_bytes", "pair_ms", "first_pair_ms")
    }
    for case in ("normal", "tilted", "turned"):
        surfaces[f"{case}_contact_db"] = spread([row[case] for row in encoding], "psnr_contact_db")
    ratios: dict[str, list[float]] = {}
    groups: dict[tuple[str, Any], list[Row]] = {}
    for row in speed:
        slow = next(way["cpu_s"] for way in row["ways"] if way["way"] == "pyrender")
        for way in row["ways"]:
            groups.setdefault((way["way"], way["setting"]), []).append(way)
            if way["way"] == "ours":
                ratios.setdefault(f"{way['setting']} x {way['setting']}", []).append(slow / way["cpu_s"])
    return {
        "ways": [
            {"way": way, "setting": setting, "objects": len(rows)}
            | {key: spread(rows, key) for key in rows[0] if key not in ("way", "setting")}
            for (way, setting), rows in groups.items()
        ],
        "times_faster_than_pyrender": {key: float(np.median(values)) for key, values in ratios.items()},
        "sizes": [
            {**same[0], "touches_a_cpu_s": float(np.median([size["touches_a_cpu_s"] for size in same]))}
            for same in zip(*(row["sizes"] for row in speed), strict=True)
        ],
        "elastic_touches_a_cpu_s": spread(speed, "elastic_touches_a_cpu_s"),
        "encoding": surfaces,
    }


SETTINGS = {
    "touches": "points drawn evenly over the area, depth .5 to 2 mm, tilt up to 15 degrees",
    "times": "CPU seconds of one thread (pyrender: of its process with the driver's threads), medians over "
    "rounds that interleave the ways; RGB, depth and mask",
    "encoding": "truth is the source mesh pressed at points drawn evenly over its area, the answer the "
    "stored surface pressed at the same points, depths and tilts; PSNR over pixels in contact in either, "
    "mean of touches, then of objects. Coordinates are stored to a micrometre, as most scans are written: "
    "where nothing is lost, images are equal. Turned: the same mesh turned round an oblique axis, so that "
    "its coordinates are no whole micrometres; 15 degrees, 2 mm",
    "psnr": "of 8-bit images, at most 58.9 dB a touch (rounding)",
}
