"""Running calls in a child process that may crash, hang or grow without harm to anything else."""

import contextlib
import os
import select
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from pipeline.child import receive, send
from pipeline.task import Call, Failure, Outcome

# One thread a task: with as many tasks as cores, more threads only wait for one another.
THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
LOG_TAIL_BYTES = 4000


@dataclass(frozen=True)
class ChildSettings:
    """How children run.

    Parameters
    ----------
    recycle_after
        Tasks after which a child is replaced, so that leaks of native code end.
    time_limit_s
        Wall seconds after which a task counts as hung.
    threads
        Threads of numerical libraries in a child.
    """

    recycle_after: int = 50
    time_limit_s: float = 7200.0
    threads: int = 1


class Child:
    """A process that runs one call at a time, started at need and replaced when it dies or is old."""

    def __init__(self, root: Path, settings: ChildSettings) -> None:
        self._root = root
        self._settings = settings
        self._scratch = tempfile.TemporaryDirectory(prefix="objectfolder-task-")
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  (lives as long as this object)
        self._process: subprocess.Popen[bytes] | None = None
        self._served = 0

    def __enter__(self) -> "Child":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        self._scratch.cleanup()

    def run(self, call: Call) -> Outcome:
        """Run a call; whatever happens to the child becomes a failure of this call alone."""
        if self._process is not None and self._served >= self._settings.recycle_after:
            self.close()
        process = self._started()
        self._log.seek(0)
        self._log.truncate()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            send(process.stdin, call)
            ready, _, _ = select.select([process.stdout], [], [], self._settings.time_limit_s)
            outcome = receive(process.stdout) if ready else None
        except BrokenPipeError:
            ready, outcome = [process.stdout], None
        except BaseException:
            self._kill()
            raise
        if isinstance(outcome, Outcome):
            self._served += 1
            return outcome
        return Outcome(call.request.object_id, self._reason(call.request.object_id, bool(ready)))

    def close(self) -> None:
        """End the child; the next call starts another."""
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(2)
        self._kill()

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self._kill()
            self._served = 0
            environment = {
                **os.environ,
                "OMP_WAIT_POLICY": "PASSIVE",
                "PYTHONHASHSEED": "0",
                "TMPDIR": self._scratch.name,
            }
            environment.update(dict.fromkeys(THREADS, str(self._settings.threads)))
            self._process = subprocess.Popen(
                [sys.executable, "-m", "pipeline.child", str(os.getpid()), self._scratch.name],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log,
                cwd=self._root,
                env=environment,
                start_new_session=True,  # so that a hung task is killed with what it started
            )
        return self._process

    def _reason(self, object_id: str, answered: bool) -> Failure:
        assert self._process is not None
        if not answered:
            self._kill()
            limit = f"{self._settings.time_limit_s:g} s"
            return Failure(
                object_id, f"no answer within {limit}", "Raise time_limit_s of the cluster.", self._tail()
            )
        code = self._process.wait()
        self._kill()
        if code == -signal.SIGKILL:
            remedy = "Out of memory, most likely: run fewer workers, or lower the settings of this stage."
            return Failure(object_id, "its process was killed (SIGKILL)", remedy, self._tail())
        if code < 0:
            name = signal.Signals(-code).name
            return Failure(
                object_id, f"its process crashed ({name})", "Report this as a defect.", self._tail()
            )
        return Failure(
            object_id, f"its process ended (exit {code})", "Report this as a defect.", self._tail()
        )

    def _kill(self) -> None:
        if self._process is None:
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()
        self._process = None

    def _tail(self) -> str:
        size = self._log.seek(0, os.SEEK_END)
        self._log.seek(max(0, size - LOG_TAIL_BYTES))
        return self._log.read().decode(errors="replace")
