"""What a strict type checker says of programs that use the library."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY

PROGRAMS = REPOSITORY / "tests" / "typed_programs"
# No public type is of these, which are most of what a checker reads.
UNREAD = """
[[tool.mypy.overrides]]
module = ["torch.*", "xarray.*", "pandas.*", "matplotlib.*"]
follow_imports = "skip"
"""


@pytest.mark.slow
def test_a_strict_checker_accepts_right_code_and_names_each_mistake(tmp_path: Path) -> None:
    # pyproject.toml is strict with the programs. Of the library what it states is read, and no body of a
    # function: `make lint` checks those, with a cache of its own.
    settings = tmp_path / "pyproject.toml"
    settings.write_text(
        (REPOSITORY / "pyproject.toml").read_text(encoding="utf-8") + UNREAD, encoding="utf-8"
    )
    options = ["--no-error-summary", "--follow-imports=silent", "--cache-dir=.mypy_cache/programs"]
    programs = [str(PROGRAMS / name) for name in ("right_program.py", "wrong_program.py")]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *options, f"--config-file={settings}", *programs],
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
