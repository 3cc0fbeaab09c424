"""A child process does not outlive its parent."""

import os
import signal
import subprocess
import sys
import time

from objectfolder.child_process import run_module

CHILD = (
    "import os, time; from objectfolder.child_process import end_with; end_with(os.getppid()); "
    "print(os.getpid(), flush=True); time.sleep(600)"
)
PARENT = f"""
import subprocess, sys
subprocess.run([sys.executable, "-c", {CHILD!r}])
"""
GENEROUS_S = 60.0


def _runs(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_a_child_imports_no_code_of_the_current_folder(tmp_path, monkeypatch) -> None:
    """As an archive that was downloaded and unpacked may have it."""
    (tmp_path / "numpy.py").write_text("print('executed')\n")
    (tmp_path / "absent.py").write_text("print('executed')\n")
    monkeypatch.chdir(tmp_path)
    process = run_module("numpy")
    assert "executed" not in process.stdout
    assert "numpy" in process.stderr  # the package, which is no program
    assert "No module named absent" in run_module("absent").stderr
    assert run_module("objectfolder.child_process", cwd=tmp_path).returncode == 0


def test_killing_the_parent_ends_the_child() -> None:
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        assert _runs(child)
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
        deadline = time.monotonic() + GENEROUS_S
        while _runs(child) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not _runs(child)
