"""What the first query of each sense costs in a fresh installation: kernels are compiled once for all.

    make wheel && OMP_NUM_THREADS=1 python -m bench first_queries --wheel dist/*.whl

Each query runs in a process of its own with an empty cache of kernels, and once more in another process with
the kernels that the first has left there. Then the wheel is unpacked, and a process asks it. The package's
mug is asked; numba's own import is counted.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from bench.record import arguments, conclude

QUERIES = {
    "sight": "mug.render(*mug.sample_views(1, seed=0), resolution=256)",
    "sound": "mug.strike(points, -normals, duration_s=1.0)",
    "touch": "mug.press(points, depth_m=0.001)",
}
PROGRAM = """
import json, sys, time
import objectfolder
mug = objectfolder.example("mug")
points, normals = mug.sample_contacts(1, seed=0, reachable=False)
spent = []
for _ in range(2):
    before = time.process_time()
    eval(sys.argv[1])
    spent.append(time.process_time() - before)
compiled = 0
if "numba" in sys.modules:
    from numba.core.dispatcher import Dispatcher
    kernels = {id(value): value for module in list(sys.modules.values()) for value in vars(module).values()
               if isinstance(value, Dispatcher) and module.__name__.startswith("objectfolder.")}
    compiled = sum(sum(kernel.stats.cache_misses.values()) for kernel in kernels.values())
print(json.dumps([*spent, compiled]))
"""
COMPARED = "CPU seconds of the first query in a fresh installation, in a new process, and of the next"


def time_queries(query: str, folder: str = ".", **environment: str) -> list[float]:
    """CPU seconds of the first and the second query of a process, and how many kernels it compiled."""
    plain = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, query], check=True, capture_output=True, text=True, cwd=folder,
        env=plain | environment,
    )  # fmt: skip
    numbers: list[float] = json.loads(done.stdout)
    return numbers


def time_queries_of_wheel(query: str, wheel: Path) -> list[float]:
    """What `time_queries` returns, of the wheel as it is unpacked."""
    with tempfile.TemporaryDirectory() as site:
        with ZipFile(wheel) as archive:
            archive.extractall(site)
        return time_queries(query, site, PYTHONPATH=site)


def measured(query: str, rounds: int, wheel: Path) -> dict[str, Any]:
    """Least CPU seconds of some fresh installations."""
    fresh, warm, of_wheel = [], [], [time_queries_of_wheel(query, wheel) for _ in range(rounds)]
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as cache:
            fresh.append(time_queries(query, NUMBA_CACHE_DIR=cache))
            warm.append(time_queries(query, NUMBA_CACHE_DIR=cache))
    return {
        "fresh_installation_cpu_s": min(first for first, _, _ in fresh),
        "all_fresh_installations_cpu_s": [first for first, _, _ in fresh],
        "new_process_cpu_s": min(first for first, _, _ in warm),
        "next_query_cpu_s": min(second for _, second, _ in fresh + warm),
        "kernels_compiled": fresh[0][2],
        "fresh_wheel_cpu_s": min(first for first, _, _ in of_wheel),
        "all_fresh_wheels_cpu_s": [first for first, _, _ in of_wheel],
        "kernels_compiled_of_wheel": of_wheel[0][2],
    }


def main() -> None:
    """Measure and record."""
    parser = arguments(__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--wheel", type=Path, required=True, help="that of `make wheel`")
    options = parser.parse_args()
    rounds, wheel = options.rounds, options.wheel.resolve()
    figures = {sense: measured(query, rounds, wheel) for sense, query in QUERIES.items()}
    conclude("first_queries", figures, {"rounds": rounds, "queries": QUERIES}, COMPARED)
