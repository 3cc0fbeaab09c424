"""The same tests are collected in every process, at any second: otherwise parallel workers refuse to run.

That they collect the same with another seed of hashes each run of several workers shows: each has its own.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
# A process with another clock. Everything else that may differ is in its environment.
COLLECT = """
import sys, time
clock = time.time
time.time = lambda: clock() + 1e6 + 1
import pytest
sys.exit(pytest.main(["--collect-only", "-q", "-p", "no:cacheprovider", *sys.argv[1:]]))
"""


@pytest.mark.slow
@pytest.mark.release("tests")
def test_another_process_collects_the_same_tests(
    collected: list[str], request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    seed = "2" if os.environ.get("PYTHONHASHSEED") != "2" else "1"
    listing = tmp_path / "collected"
    environment = {"PYTHONHASHSEED": seed, "TZ": "Pacific/Auckland", "TMPDIR": str(tmp_path)}
    subprocess.run(
        [sys.executable, "-c", COLLECT, *request.config.args],
        cwd=REPOSITORY,
        env={**os.environ, **environment, "COLLECTED_FILE": str(listing)},
        stdout=subprocess.PIPE,
        check=True,
    )
    assert listing.read_text().split("\n") == collected


def test_no_name_of_a_test_holds_a_path_of_this_machine(collected: list[str]) -> None:
    for folder in (str(REPOSITORY), str(Path.home()), "/tmp"):
        assert [test for test in collected if f"{folder}/" in test] == []
