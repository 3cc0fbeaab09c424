"""The same tests are collected in every process, at any second: otherwise parallel workers refuse to run."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
# A process with another clock. Everything else that may differ is in its environment.
COLLECT = """
import sys, time
clock, shift = time.time, float(sys.argv[1])
time.time = lambda: clock() + shift
import pytest
sys.exit(pytest.main(["--collect-only", "-q", "-p", "no:cacheprovider", "tests"]))
"""


def started(shift_s: float, **environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", COLLECT, str(shift_s)],
        cwd=REPOSITORY,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
def test_two_processes_collect_the_same_tests(tmp_path: Path) -> None:
    processes = [
        started(0.0, PYTHONHASHSEED="1"),
        started(1e6 + 1, PYTHONHASHSEED="2", TZ="Pacific/Auckland", TMPDIR=str(tmp_path)),
    ]
    one, other = (process.communicate()[0].splitlines() for process in processes)
    assert [process.returncode for process in processes] == [0, 0]
    tests = [line for line in one if "::" in line]
    assert len(tests) > 1000
    assert [line for line in other if "::" in line] == tests
    for folder in (str(REPOSITORY), str(Path.home()), "/tmp"):
        assert [test for test in tests if f"{folder}/" in test] == []
