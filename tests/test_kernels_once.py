"""Processes that reach the same kernel at once compile it once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from filelock import FileLock

REPOSITORY = Path(__file__).parents[1]
KERNEL = """
import numba

@numba.njit(cache=True)
def twice(x):
    return 2 * x
"""
CALL = """
import sys
from pathlib import Path
from tests import kernels_once
kernels_once.register(Path.cwd())
from some_kernel import twice
print("ready", flush=True)
assert twice(2) == 4
print(sum(twice.stats.cache_misses.values()))
"""


@pytest.mark.slow
def test_one_of_two_processes_compiles_and_the_other_loads(tmp_path: Path) -> None:
    (tmp_path / "some_kernel.py").write_text(KERNEL)
    path = os.pathsep.join([str(tmp_path), str(REPOSITORY)])
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    with FileLock(tmp_path / "some_kernel.twice.lock"):  # so that they reach it at the same time
        processes = [
            subprocess.Popen(
                [sys.executable, "-c", CALL], cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True
            )
            for _ in range(2)
        ]
        for process in processes:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
    assert sorted(process.communicate()[0] for process in processes) == ["0\n", "1\n"]
