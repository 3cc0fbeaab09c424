"""The process in which task bodies run: ``python -m pipeline.child PARENT_PID SCRATCH_FOLDER``.

It reads pickled calls from standard input and answers with pickled outcomes on what was standard
output; the task's own output goes to standard error. It works in a scratch folder, where native code
may leave what it likes, and dies with its parent.
"""

import contextlib
import importlib
import os
import pickle
import resource
import signal
import sys
import time
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from objectfolder.child_process import end_with
from pipeline import memo, products
from pipeline.task import Call, Outcome, Timed, failure_of

LENGTH_BYTES = 8


def send(stream: IO[bytes], message: Any) -> None:
    """Write one pickled message with its length before it."""
    data = pickle.dumps(message)
    stream.write(len(data).to_bytes(LENGTH_BYTES, "little") + data)
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Read one message; None where the other side is gone."""
    head = stream.read(LENGTH_BYTES)
    if len(head) < LENGTH_BYTES:
        return None
    length = int.from_bytes(head, "little")
    data = stream.read(length)
    return pickle.loads(data) if len(data) == length else None


def execute(call: Call) -> Outcome:
    """Run a task body, write its products with their provenance, and say what it cost."""
    begin, cpu = time.perf_counter(), _cpu_seconds()
    offspring = _largest_offspring_bytes()
    _reset_peak()
    failure = None
    query_seconds: Mapping[str, float] = {}
    try:
        module, _, function = call.task.partition(":")
        returned = getattr(importlib.import_module(module), function)(call.request)
        if isinstance(returned, Timed):
            returned, query_seconds = returned.products, returned.query_seconds
        contents = returned if isinstance(returned, tuple) else (returned,)
        if len(contents) != len(call.targets):
            raise TypeError(
                f"{call.task} returned {len(contents)} products where {len(call.targets)} are declared"
            )
        for target, content in zip(call.targets, contents, strict=True):
            products.write(target, content, call.fingerprint, dict(call.parts))
            if call.memo is not None:
                memo.remember(call.memo, target)
    except (Exception, SystemExit) as error:
        failure = failure_of(call.request.object_id, error, traceback.format_exc(limit=-12))
    return Outcome(
        call.request.object_id,
        failure,
        time.perf_counter() - begin,
        _cpu_seconds() - cpu,
        max(_peak_bytes(), _largest_offspring_bytes() if _largest_offspring_bytes() > offspring else 0),
        call.fingerprint,
        query_seconds,
    )


def main() -> None:
    """Serve calls until standard input ends."""
    parent = int(sys.argv[1])
    end_with(parent)
    os.chdir(sys.argv[2])
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what native code prints must not mix with the answers
    calls = sys.stdin.buffer
    # A clean exit at interruption is the parent's to decide.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while (call := receive(calls)) is not None:
        outcome = execute(call)
        sys.stdout.flush()
        send(answers, outcome)
    answers.flush()
    os._exit(0)  # native libraries that crash while they are taken down have nothing left to lose


def _cpu_seconds() -> float:
    used = (resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


def _largest_offspring_bytes() -> int:
    """Return the peak of the largest process this one ever started and waited for."""
    return 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss


def _reset_peak() -> None:
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak_bytes() -> int:
    with contextlib.suppress(OSError, StopIteration, ValueError):
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * int(next(line for line in lines if line.startswith("VmHWM")).split()[1])
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    main()
