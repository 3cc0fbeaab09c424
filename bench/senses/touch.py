"""Touch: seconds against error of the renderer and its rivals, elastic contacts, stored surfaces.

    python -m bench.senses.touch --objects CATALOGUE.csv --cache FOLDER

Rows that are finished are kept in FOLDER and not made again: delete ``*.row.json`` to measure again. Speeds
are touches a CPU second with their set-up (boxes over the faces, compilation) left out and stated beside
them. The comparison with TACTO itself is `bench.senses.touch_tacto`.
"""

import argparse
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.record import arguments, versions, write
from bench.senses.touch_objects import OBJECTS, names, surface_of

# A smooth body, a tool with a head and a handle, a figure with thin parts.
SPEED_OBJECTS = ("011_banana", "048_hammer", "Schleich_African_Black_Rhino")
BARS = {
    "touches_a_cpu_s_160x120": 800.0,
    "times_pyrender": 60.0,
    "touches_a_cpu_s_320x240": 200.0,
    "elastic_solves_a_cpu_s": 50.0,
    "stored_surface_median_bytes": 0.1e6,
    "contact_psnr_db": 48.0,
    "contact_psnr_tilted_db": 45.0,
    "pair_ms": 16.0,
}
COMPARED = (
    "Touches of a DIGIT: this renderer over samples, pyrender, Embree's rays, the papers' "
    "networks, mean image, no contact: CPU seconds, PSNR in the contact region against 8 x 8 samples; "
    "elastic contacts a CPU second; stored surfaces by bytes and PSNR against the source mesh pressed alike"
)


def main() -> None:
    parser = arguments("touch: seconds, error and bytes")
    parser.add_argument("--objects", type=Path, required=True, help="catalogue of meshes, CSV")
    parser.add_argument("--cache", type=Path, required=True, help="where meshes and rows are kept")
    parser.add_argument("--speed-objects", nargs="+", default=list(SPEED_OBJECTS))
    parser.add_argument("--encoded-objects", nargs="+", default=list(OBJECTS))
    parser.add_argument("--network-objects", type=int, default=1, help="for how many of the speed objects")
    parser.add_argument("--network-cpu-s", type=float, default=60.0, help="training of each network")
    parser.add_argument("--training-touches", type=int, default=300)
    parser.add_argument("--held-out-touches", type=int, default=24)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--object-file", type=Path, help="a finished Object File to press as well")
    given = parser.parse_args()
    if not given.objects.is_file():
        print(f"skipped: no catalogue of objects at {given.objects}")
        return
    missing = {*given.speed_objects, *given.encoded_objects} - names(given.objects)
    if missing:
        parser.error(f"not in {given.objects}: {', '.join(sorted(missing))}")
    os.environ["NUMBA_NUM_THREADS"] = "1"
    import torch

    torch.set_num_threads(1)
    given.cache.mkdir(parents=True, exist_ok=True)
    from bench.senses.touch_elastic import measure_elastic
    from bench.senses.touch_encoding import measure_encoding, measure_object_file
    from bench.senses.touch_outcome import draw_touch
    from bench.senses.touch_speed import Speed
    from bench.senses.touch_summary import summarised

    def surface(name: str) -> Any:
        return surface_of(given.objects, name, given.cache)

    speed = []
    for index, name in enumerate(given.speed_objects):
        networks = index < given.network_objects
        measure = Speed(given, name, networks).measure
        speed.append(_kept(given, f"{name}.speed", lambda run=measure, at=name: run(surface(at))))
    elastic = [
        _kept(given, f"{name}.elastic", lambda at=name: measure_elastic(surface(at), at))
        for name in given.speed_objects
    ]
    encoded = [
        _kept(given, f"{name}.encoding", lambda at=name: measure_encoding(surface(at), at))
        for name in given.encoded_objects
    ]
    opened = None
    if given.object_file is not None:
        opened = _kept(
            given, f"{given.object_file.stem}.object_file", lambda: measure_object_file(given.object_file)
        )
    summary = summarised(speed, elastic, encoded, opened, BARS)
    rows = {"speed": speed, "elastic": elastic, "encoding": encoded, "object_file": opened}
    write("touch", {"summary": summary, "bars": BARS, "rows": rows}, _settings(given), COMPARED)
    draw_touch(summary, encoded)
    print(json.dumps(summary, indent=1))


def _kept(given: argparse.Namespace, key: str, measure: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return what `measure` finds, or what it found before."""
    path = given.cache / f"{key}.row.json"
    if not path.exists():
        row = {**measure(), "commit": versions()["commit"]}
        path.write_text(json.dumps(row), encoding="utf-8")
        print(key, "measured", flush=True)
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def _settings(given: argparse.Namespace) -> dict[str, Any]:
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


if __name__ == "__main__":
    main()
