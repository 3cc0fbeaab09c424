"""Modules that run in a process of their own: native code that nothing else could stop or clean up after."""

import contextlib
import ctypes
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

PR_SET_PDEATHSIG = 1
CHECK_INTERVAL_S = 1.0
OUT_OF_TIME = -signal.SIGXCPU  # exit status of a process that reached the limit of `limit_cpu_time`


def module_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module; files of the current folder are no modules to it (`-P`)."""
    return [sys.executable, "-P", "-m", module, *arguments]


def search_path() -> str:
    """Return the `PYTHONPATH` by which a child finds this package, before the paths that it lists already."""
    root = str(Path(__file__).resolve().parents[1])
    return os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))


def run_module(
    module: str,
    *arguments: Path,
    cwd: Path | None = None,
    timeout_s: float | None = None,
    environment: dict[str, str] | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run `python -m MODULE ARGUMENTS` with this package on its path, and wait for it.

    Parameters
    ----------
    cwd
        Where it runs; here if None.
    timeout_s
        Wall seconds before it is killed; without limit if None.
    environment
        Variables besides those of this process.

    Raises
    ------
    subprocess.TimeoutExpired
        It took longer than `timeout_s`.
    """
    return subprocess.run(
        module_command(module, *map(str, arguments)),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        cwd=cwd,
        timeout=timeout_s,
        env={**os.environ, "PYTHONPATH": search_path(), **(environment or {})},
    )


def last_words(stderr: str, lines: int = 1) -> str:
    """Return the last lines that a process wrote, joined by slashes."""
    return " / ".join(stderr.strip().splitlines()[-lines:]) or "no message"


def limit_cpu_time(seconds: int) -> None:
    """End this process with status `OUT_OF_TIME` after that many CPU seconds.

    The hard limit comes later: where both are equal the kernel kills as it does for lack of memory.
    """
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))


def end_with(parent: int) -> None:
    """End this process when the process `parent`, which started it, ends, whatever is being computed.

    Linux's kernel does it at once; elsewhere a thread looks every second.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(CHECK_INTERVAL_S)
        os._exit(1)

    if os.getppid() != parent:
        os._exit(1)
    threading.Thread(target=watch, daemon=True).start()
