"""What the first query of each sense costs in a fresh installation: kernels are compiled once for all.

    OMP_NUM_THREADS=1 python -m bench.senses.first_queries

Each query runs in a process of its own with an empty cache of kernels, and once more in another process with
the kernels that the first has left there. The package's mug is asked; numba's own import is counted.
"""

import json
import os
import subprocess
import sys
import tempfile
from typing import Any

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


def asked(query: str, cache: str) -> list[float]:
    """CPU seconds of the first and the second query of a process, and how many kernels it compiled."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, query], check=True, capture_output=True, text=True,
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
    )  # fmt: skip
    numbers: list[float] = json.loads(done.stdout)
    return numbers


def measured(query: str, rounds: int) -> dict[str, Any]:
    """Least CPU seconds of some fresh installations."""
    fresh, known = [], []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as cache:
            fresh.append(asked(query, cache))
            known.append(asked(query, cache))
    return {
        "fresh_installation_cpu_s": min(first for first, _, _ in fresh),
        "all_fresh_installations_cpu_s": [first for first, _, _ in fresh],
        "new_process_cpu_s": min(first for first, _, _ in known),
        "next_query_cpu_s": min(second for _, second, _ in fresh + known),
        "kernels_compiled": fresh[0][2],
    }


def main() -> None:
    """Measure and record."""
    parser = arguments(__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    figures = {sense: measured(query, rounds) for sense, query in QUERIES.items()}
    conclude("first_queries", figures, {"rounds": rounds, "queries": QUERIES}, COMPARED)


if __name__ == "__main__":
    main()
