"""Two runs on one checkout: the second waits or refuses, and a killed owner blocks nobody."""

import io
import os
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from objectfolder.errors import InputError
from pipeline.dataset.project_files import DASHBOARD
from pipeline.run.exclusive import WAIT, exclusive, owner

HOLD = """
import sys
from pathlib import Path
from pipeline.run.exclusive import exclusive

with exclusive(Path(sys.argv[1]), sys.argv[2]):
    print("held", flush=True)
    sys.stdin.readline()
"""
PATIENCE_S = 60


@contextmanager
def holder(root: Path, what: str = "stage views"):
    """Another process that holds the checkout until it reads a line."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(root), what],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.communicate(timeout=PATIENCE_S)


def test_second_run_waits_for_the_first_and_says_for_whom(tmp_path):
    said = Said()
    entered = threading.Event()

    def second():
        with exclusive(tmp_path, "stage modes", said):
            entered.set()

    with holder(tmp_path) as first:
        thread = threading.Thread(target=second)
        thread.start()
        assert said.line.wait(PATIENCE_S)
        assert not entered.is_set()
        assert f"waiting for process {first.pid}, which has run stage views since " in said.getvalue()
        first.stdin.write("\n")
        first.stdin.flush()
        thread.join(PATIENCE_S)
    assert entered.is_set()
    assert owner(tmp_path) is None


def test_second_run_refuses_where_it_may_not_wait(tmp_path, monkeypatch):
    monkeypatch.setenv(WAIT, "0")
    with holder(tmp_path) as first, pytest.raises(InputError) as raised, exclusive(tmp_path, "stage modes"):
        pytest.fail("two runs at once")
    assert f"in use by process {first.pid}, which has run stage views" in raised.value.finding
    assert "OBJECTFOLDER_WAIT" in raised.value.remedy


def test_waiting_ends_after_the_seconds_allowed(tmp_path, monkeypatch):
    monkeypatch.setenv(WAIT, "0.3")
    with holder(tmp_path), pytest.raises(InputError), exclusive(tmp_path, "stage modes"):
        pytest.fail("two runs at once")


@pytest.mark.parametrize("text", ["soon", "-1", "nan"])
def test_no_number_of_seconds_is_an_error(tmp_path, monkeypatch, text):
    monkeypatch.setenv(WAIT, text)
    with pytest.raises(InputError, match="not a number of at least 0"), exclusive(tmp_path, "stage modes"):
        pytest.fail("entered")


def test_a_killed_owner_blocks_nobody(tmp_path, monkeypatch):
    monkeypatch.setenv(WAIT, "0")
    with holder(tmp_path) as first:
        (tmp_path / DASHBOARD).write_text("http://127.0.0.1:8787/status")
        assert f"process {first.pid}, " in owner(tmp_path)
        assert owner(tmp_path).endswith(", dashboard http://127.0.0.1:8787/status")
        os.kill(first.pid, signal.SIGKILL)
        first.wait(PATIENCE_S)
        with exclusive(tmp_path, "stage modes"):
            assert "stage modes" in owner(tmp_path)
            assert "dashboard" not in owner(tmp_path)


def test_programs_that_a_killed_owner_started_do_not_hold_its_lock(tmp_path, monkeypatch):
    monkeypatch.setenv(WAIT, "0")
    script = HOLD.replace(
        'print("held"',
        "import subprocess; print(subprocess.Popen(['sleep', '600']).pid, flush=True); print('held'",
    )
    first = subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path), "x"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    sleeper = int(first.stdout.readline())
    try:
        assert first.stdout.readline() == "held\n"
        first.kill()
        first.wait(PATIENCE_S)
        os.kill(sleeper, 0)
        with exclusive(tmp_path, "stage modes"):
            pass
    finally:
        os.kill(sleeper, signal.SIGKILL)
        first.stdin.close()
        first.stdout.close()


def test_a_run_of_another_checkout_is_no_part_of_this_one(tmp_path, monkeypatch):
    monkeypatch.setenv(WAIT, "0")
    first, second = tmp_path / "one", tmp_path / "other"
    with holder(second), exclusive(first, "x"), pytest.raises(InputError), exclusive(second, "x"):
        pytest.fail("two runs at once")


class Said(io.StringIO):
    """A stream that tells when something was written."""

    def __init__(self) -> None:
        super().__init__()
        self.line = threading.Event()

    def write(self, text: str) -> int:
        count = super().write(text)
        self.line.set()
        return count
