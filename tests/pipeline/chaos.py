"""Runs disturbed on purpose: products read all the while, processes found and killed, repetitions counted."""

import contextlib
import math
import signal
import threading
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import psutil
from ground import Execution, Ground, is_whole, wait_for


class Watcher:
    """Reads every file under its final name whenever it has changed, and notes those that are not whole."""

    def __init__(self, ground: Ground) -> None:
        self._root = ground.root
        self._patterns = [f"{folder}/*" for folder in ground.folders]
        self._seen: dict[Path, tuple[int, int, int]] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self.reads = 0
        self.broken: list[str] = []
        self.whole_since: dict[Path, float] = {}  # modification time of the first whole version

    def __enter__(self) -> "Watcher":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        self.look()

    def look(self) -> None:
        """Read all that has changed."""
        for pattern in self._patterns:
            for path in self._root.glob(pattern):
                if path.name.startswith("."):
                    continue
                with contextlib.suppress(FileNotFoundError):
                    status = path.stat()
                    state = status.st_size, status.st_mtime_ns, status.st_ino
                    if self._seen.get(path) != state:
                        self._seen[path] = state
                        self.reads += 1
                        if is_whole(path):
                            self.whole_since.setdefault(path, status.st_mtime)
                        elif path.exists():
                            self.broken.append(str(path.relative_to(self._root)))

    def _watch(self) -> None:
        while not self._stop.wait(0.01):
            self.look()


@dataclass(frozen=True)
class Killed:
    """What a kill hit: tasks and objects at work, those whose products stood already apart."""

    what: str
    pid: int
    running: tuple[tuple[str, str], ...]
    committed: tuple[tuple[str, str], ...]


def victims(ground: Ground, spared: Collection[tuple[str, str]] = ()) -> dict[str, list[psutil.Process]]:
    """Return the processes that run tasks, those at what is spared left out, and their workers."""
    alive = {process.pid: process for process in ground.processes()}
    last = {execution.pid: execution.work for execution in ground.executions()}
    children = [alive[pid] for pid in sorted(last.keys() & alive.keys()) if last[pid] not in spared]
    workers = []
    for child in children:
        with contextlib.suppress(psutil.Error):
            workers += [parent for parent in child.parents() if is_worker(parent) and parent not in workers]
    return {"child": children, "worker": workers}


def is_worker(process: psutil.Process) -> bool:
    """Whether a process is one of Dask's workers: started by a nanny, here or by command."""
    return "spawn_main" in " ".join(process.cmdline())


def kill(ground: Ground, what: str, process: psutil.Process) -> Killed:
    """Kill a process, wait for those that die with it, and say what was cut short."""
    hit = victims(ground)["child"] if what in ("driver", "scheduler") else []
    doomed = [process]
    with contextlib.suppress(psutil.Error):
        doomed += process.children(recursive=True)
    process.send_signal(signal.SIGKILL)
    wait_for(lambda: all(map(is_gone, doomed)), f"all that belongs to the {what} is gone")
    pids = {victim.pid for victim in (*doomed, *hit)}
    last = {execution.pid: execution.work for execution in ground.executions() if execution.pid in pids}
    stood = {work for work in last.values() if ground.stands(work)}
    return Killed(what, process.pid, tuple(sorted(set(last.values()) - stood)), tuple(sorted(stood)))


def is_gone(process: psutil.Process) -> bool:
    """Whether a process has ended, waited for or not."""
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.Error:
        return True


def redone(ground: Ground, executions: Iterable[Execution], since: Mapping[Path, float]) -> dict[str, int]:
    """Return how often tasks began although all their products stood since before."""
    counts: Counter[str] = Counter()
    stages = {stage.name: stage for stage in ground.toys.stages}
    for execution in executions:
        targets = stages[execution.task].targets(ground.root, execution.object_id)
        if all(since.get(path, math.inf) < execution.time for path in targets):
            counts[" ".join(execution.work)] += 1
    return dict(counts)


def unexplained(executions: Iterable[Execution], kills: Collection[Killed]) -> dict[str, int]:
    """Return what began more often than kills that no run ends of account for, and how much more often."""
    allowed = Counter(work for killed in kills for work in killed.running)
    counts = Counter(execution.work for execution in executions)
    return {
        " ".join(work): count - 1 - allowed[work]
        for work, count in counts.items()
        if count > 1 + allowed[work]
    }
