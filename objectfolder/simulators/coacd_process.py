"""CoACD in a process of its own, which a limit of CPU time can end: `coacd_process SURFACE.npz HULLS.npz`."""

import os
import sys
from pathlib import Path

import numpy as np

from objectfolder.child_process import end_with, limit_cpu_time

# Of CoACD's tree search and its samples. Its remeshing of open surfaces doubles the seconds of a mug.
SEARCH = {"mcts_iterations": 60, "mcts_nodes": 10, "resolution": 1000, "preprocess_mode": "off"}


def main(source: Path, target: Path) -> None:
    """Part the surface of one file, and write the vertices of its hulls to the other."""
    import coacd

    with np.load(source) as arrays:
        limit_cpu_time(int(arrays["time_limit_s"]))
        coacd.set_log_level("error")
        parts = coacd.run_coacd(
            coacd.Mesh(arrays["vertices"], arrays["faces"]),
            threshold=float(arrays["threshold_m"]),
            max_convex_hull=int(arrays["most_parts"]),
            real_metric=True,
            seed=int(arrays["seed"]),
            **SEARCH,
        )
    np.savez(target, *(np.asarray(vertices, dtype=np.float64) for vertices, _ in parts))


if __name__ == "__main__":
    end_with(os.getppid())
    main(Path(sys.argv[1]), Path(sys.argv[2]))
