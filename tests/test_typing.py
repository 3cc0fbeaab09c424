"""What a strict type checker says of programs that use the library."""

import re
import subprocess
import sys

import pytest

from tests.conftest import REPOSITORY

PROGRAMS = REPOSITORY / "tests" / "typed_programs"


@pytest.mark.slow
def test_a_strict_checker_accepts_right_code_and_names_each_mistake() -> None:
    # pyproject.toml is strict with the programs. The settings and the cache are those of `make lint`, which
    # has read the library before.
    programs = [str(PROGRAMS / name) for name in ("right_program.py", "wrong_program.py")]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-error-summary", *programs],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )
    errors = re.findall(r"(\w+)\.py:(\d+): error: .*\[([\w-]+)\]$", done.stdout, flags=re.MULTILINE)
    lines = (PROGRAMS / "wrong_program.py").read_text(encoding="utf-8").splitlines()
    mistakes = [
        ("wrong_program", str(number), line.rpartition("# ")[2])
        for number, line in enumerate(lines, 1)
        if "  # " in line
    ]
    assert len(mistakes) == 13
    assert errors == mistakes, done.stdout + done.stderr
