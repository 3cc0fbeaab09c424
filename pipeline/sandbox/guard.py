"""The process above a task's processes: ``python -m pipeline.sandbox.guard SCRATCH``.

It forks the process in which task bodies run (`child.py`) and waits. When that one ends, or when
whoever started the guard is gone (its end of standard input closes, however it died), or on SIGTERM, the
guard ends every process that is left of the task: as their subreaper it is handed those whose own parents
died, so that nothing native code started is ever orphaned. It then ends as the task's process did. If the
guard itself is killed, the task's process goes with it.

It imports little, for one of it stands beside every task.
"""

import contextlib
import ctypes
import os
import resource
import select
import signal
import sys

from pipeline.sandbox.process_tree import descendants

SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER
CHOSEN_FIRST = "600"  # by the kernel when memory runs out: a task's processes, not workers and drivers


def main() -> None:
    """Run and guard a task's process; end as it ended."""
    guard = os.getpid()
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0)
    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(wake)
    for number in (signal.SIGCHLD, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    task = os.fork()
    if task == 0:
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGCHLD, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        os.close(woken)
        os.close(wake)
        with contextlib.suppress(OSError), open("/proc/self/oom_score_adj", "w") as file:
            file.write(CHOSEN_FIRST)
        from pipeline.sandbox.child import serve

        serve(guard, scratch=sys.argv[1])
    os.dup2(2, 1)  # that the end of the answers is seen when the task's process ends
    status = _wait(task, woken)
    end = _end_all(task)
    _end_as(end if status is None else status)


def _wait(task: int, woken: int) -> int | None:
    """Return the status with which the task ended; None where it must be ended."""
    poll = select.poll()
    poll.register(0, 0)  # only that the other end has closed
    poll.register(woken, select.POLLIN)
    while True:
        ready = {descriptor for descriptor, _ in poll.poll()}
        if woken in ready and signal.SIGTERM in os.read(woken, 4096):
            return None
        with contextlib.suppress(ChildProcessError):
            while (ended := os.waitpid(-1, os.WNOHANG))[0]:
                if ended[0] == task:
                    return ended[1]
        if 0 in ready:
            return None


def _end_all(task: int) -> int:
    """Kill every process below this one; return the status of `task`, if it is among them."""
    task_status = 0
    while True:
        for pid in descendants(os.getpid()):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        try:
            pid, status = os.waitpid(-1, 0)
        except ChildProcessError:
            return task_status
        if pid == task:
            task_status = status


def _end_as(status: int) -> None:
    """End with the exit code or the signal of a wait status, leaving no core file."""
    number = -os.waitstatus_to_exitcode(status)
    if number > 0:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if number != signal.SIGKILL:
            signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
    os._exit(-number)


if __name__ == "__main__":
    main()
