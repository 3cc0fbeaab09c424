"""Running calls in a child process that may crash, hang or grow without harm to anything else."""

import contextlib
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

from objectfolder import instructions
from objectfolder.child_process import module_command, search_path
from pipeline.dataset.task import Call, Failure, Outcome
from pipeline.sandbox import host_memory, scratch
from pipeline.sandbox.child import STALE
from pipeline.sandbox.memory_watch import MemoryWatch, resident_bytes
from pipeline.sandbox.process_tree import descendants, end_with_variable

# Libraries take other paths on newer processors, whose sums differ in the last bits; a fit amplifies them.
# With these settings a processor with AVX-512 makes the bytes of one with AVX2 of the same vendor. What
# differs between vendors is in docs/reproducibility.md. numba's target is set in `objectfolder.jit`.
AVX2: Mapping[str, str] = {
    "ATEN_CPU_CAPABILITY": "avx2",
    "MKL_CBWR": "AVX2",
    "MKL_ENABLE_INSTRUCTIONS": "AVX2",
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL",
    "ONEDNN_MAX_CPU_ISA": "AVX2",
    instructions.VARIABLE: instructions.KERNEL,
}


def instruction_settings() -> Mapping[str, str]:
    """Return the environment of a task's process; nothing where the processor has no AVX2."""
    return AVX2 if instructions.has_avx2() else {}


# One thread a task: with as many tasks as cores, more threads only wait for one another.
THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
# By default, glibc returns every large array to the system and asks for the next one anew, whose pages are
# then zeroed one by one: a sixth of the CPU seconds of all stages. Arrays up to the first number come
# from the heap; free memory at its end goes back when it exceeds the second.
GLIBC = {"MALLOC_MMAP_THRESHOLD_": str(256 << 20), "MALLOC_TRIM_THRESHOLD_": str(512 << 20)}
LOG_TAIL_BYTES = 4000
LOG_LIMIT_BYTES = 16 << 20
GUARD_ENDS_S = 10.0  # within which a guard has ended all that it guards
FEWER_WORKERS = "The host ran out of memory: run fewer workers, or lower the settings of this stage."
DEFECT = "Report this as a defect."


class ProcessKilled(Exception):
    """A child was killed from outside (an operator, the system), which need not be its task's fault."""


class Interrupted(Exception):
    """A call was given up by `Child.interrupt`."""


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
    memory_limit_bytes
        What a task's processes may use together; None for nine tenths of the host's memory.
    recycle_above_bytes
        Memory that a child holds between tasks above which it is replaced.
    """

    recycle_after: int = 50
    time_limit_s: float = 7200.0
    threads: int = 1
    memory_limit_bytes: int | None = None
    recycle_above_bytes: int = 1 << 30


class Child:
    """A process that runs one call at a time, started when needed and replaced when it dies or is old."""

    def __init__(self, root: Path, settings: ChildSettings) -> None:
        self._root = root
        self._settings = settings
        scratch.sweep()
        self._scratch = scratch.Scratch()
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  (lives as long as this object)
        self._process: subprocess.Popen[bytes] | None = None  # the guard of the child
        self._served = 0
        self._interrupted = threading.Event()

    def __enter__(self) -> "Child":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
        self._scratch.cleanup()

    def run(self, call: Call, expected_bytes: int = 0) -> Outcome:
        """Run a call; a child that dies fails this call and no other.

        Parameters
        ----------
        call
            What to run, on files at hand or with products that travel through a store.
        expected_bytes
            Expected peak memory. Where its host runs short, a task far above this ends; 0 if not known.

        Raises
        ------
        ProcessKilled
            The child was killed by somebody else; the call may be tried again.
        Interrupted
            `interrupt` was called meanwhile.
        """
        if self._is_old():
            self.close()
        kills = host_memory.out_of_memory_kills()
        answer, peak = self._answer(call, expected_bytes)
        if answer == STALE:
            self.close()
            answer, peak = self._answer(call, expected_bytes)
        object_id = call.request.object_id
        if isinstance(answer, Outcome):
            self._served += 1
            if answer.failure is not None and host_memory.out_of_memory_kills() > kills:
                answer = replace(answer, failure=replace(answer.failure, remedy=FEWER_WORKERS))
            return replace(answer, peak_bytes=max(answer.peak_bytes, peak))
        if isinstance(answer, Failure):
            self.close()
            failure = replace(answer, detail=self._tail())
        elif answer == STALE:
            finding = "the code of this stage changed while the run was going on"
            failure = Failure(object_id, finding, "Run again.")
        else:
            failure = self._reason(object_id, host_memory.out_of_memory_kills() > kills)
        return Outcome(object_id, failure, peak_bytes=peak)

    def interrupt(self) -> None:
        """Give up the call that runs, from any thread; the one that is in `run` gets `Interrupted`."""
        self._interrupted.set()
        process = self._process
        if process is not None:
            process.send_signal(signal.SIGTERM)

    def _answer(self, call: Call, expected_bytes: int) -> tuple[Any, int]:
        """Return the child's outcome, why it must end, or None where it died; and the peak memory seen."""
        self._interrupted.clear()
        process = self._started()
        self._log.seek(0)
        self._log.truncate()
        watch = MemoryWatch(process.pid, self._settings.memory_limit_bytes, expected_bytes)
        try:
            self._calls.send(call)
            answer = self._watched(watch, call.request.object_id) or self._answers.recv()
        except (EOFError, OSError):  # it ended before the whole was sent
            answer = None
        except BaseException:
            self.close()
            raise
        if self._interrupted.is_set() and not isinstance(answer, Outcome):
            self.close()
            raise Interrupted(call.request.object_id)
        return answer, watch.peak_bytes

    def _watched(self, watch: MemoryWatch, object_id: str) -> Failure | None:
        """Wait until a child answers or ends; return why it must end before."""
        limit_s = self._settings.time_limit_s
        deadline = time.monotonic() + limit_s
        while (remaining_s := deadline - time.monotonic()) > 0:
            if self._answers.poll(min(remaining_s, watch.pause_s)):
                return None
            failure = watch.look(object_id)
            if failure is not None:
                return failure
            if os.fstat(self._log.fileno()).st_size > LOG_LIMIT_BYTES:
                self._log.seek(0)
                self._log.truncate()
        return Failure(object_id, f"no answer within {limit_s:g} s", "Raise time_limit_s of the cluster.")

    def _is_old(self) -> bool:
        if self._process is None:
            return False
        resting = resident_bytes(descendants(self._process.pid))
        return self._served >= self._settings.recycle_after or resting > self._settings.recycle_above_bytes

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self.close()
            self._served = 0
            folder = self._scratch.name
            environment = {
                **instruction_settings(),
                **os.environ,  # a choice of the user's holds
                **GLIBC,  # Dask sets its workers' allocator to return memory at once; tasks reuse theirs
                "OMP_WAIT_POLICY": "PASSIVE",
                "PYTHONHASHSEED": "0",
                "PYTHONPATH": search_path(),  # that processes of a task find the same code as the task
                "TMPDIR": folder,
            }
            environment.update(dict.fromkeys(THREADS, str(self._settings.threads)))
            calls, self._calls = Pipe(duplex=False)
            self._answers, answers = Pipe(duplex=False)
            with calls, answers:
                self._process = subprocess.Popen(
                    module_command("pipeline.sandbox.guard", folder),
                    stdin=calls.fileno(),
                    stdout=answers.fileno(),
                    stderr=self._log,
                    cwd=self._root,
                    env=environment,
                    start_new_session=True,  # so that only the starter gets the signals of a terminal
                )
        return self._process

    def _reason(self, object_id: str, out_of_memory: bool) -> Failure:
        """Return why a child ended without an answer."""
        assert self._process is not None
        code = self._process.wait()
        self.close()
        if code == -signal.SIGKILL and not out_of_memory:
            raise ProcessKilled("its process was killed (SIGKILL)")
        if code == -signal.SIGKILL:
            finding = "its process was killed by the system, which had run out of memory"
            remedy = FEWER_WORKERS
        elif code < 0:
            finding, remedy = f"its process crashed ({signal.Signals(-code).name})", DEFECT
        else:
            finding, remedy = f"its process ended (exit {code})", DEFECT
        return Failure(object_id, finding, remedy, self._tail())

    def close(self) -> None:
        """End the guard and so its processes; the next call starts others.

        If the guard was killed, its processes end here.
        """
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.send_signal(signal.SIGTERM)
            process.wait(GUARD_ENDS_S)
        if process.poll() is None:
            process.kill()
        if process.wait() == -signal.SIGKILL:
            end_with_variable("TMPDIR", self._scratch.name)
        self._calls.close()
        self._answers.close()

    def _tail(self) -> str:
        size = self._log.seek(0, os.SEEK_END)
        self._log.seek(max(0, size - LOG_TAIL_BYTES))
        return self._log.read().decode(errors="replace")
