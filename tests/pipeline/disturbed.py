"""One data set made while parts of its run are killed, and what became of it.

A `Round` is a folder, some kills, and runs until all is made. Workers are those of a cluster of the
driver's own (``local``), or join a scheduler that is a process of its own (``address``).
"""

import contextlib
import random
import socket
import subprocess
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import psutil
from chaos import Killed, Watcher, kill, redone, unexplained, victims
from ground import GENEROUS_S, REPOSITORY, Ground, wait_for

SCHEDULER, DRIVER, WORKER, CHILD = "scheduler", "driver", "worker", "child"
LOCAL, ADDRESS = "local", "address"
SURVIVED = frozenset({WORKER, CHILD})  # kills that no run ends of
# Becomes the script that keeps a worker, with this Python in front of its path.
WORKER_SCRIPT = f"""
import os, sys
os.environ["PATH"] = os.path.dirname(sys.executable) + os.pathsep + os.environ["PATH"]
os.execv({str(REPOSITORY / "cluster" / "worker.sh")!r}, ["worker.sh", *sys.argv[1:]])
"""
LONGER = 4.0  # than a toy's tasks: on a busy machine, a run of theirs is over before a kill comes
TASK_S = 0.2 * LONGER
MOST_RUNS = 3  # that may be needed besides one for each kill of a driver or scheduler


class Round:
    """A disturbed making of a data set.

    Parameters
    ----------
    ground
        Where, and of what.
    place
        `LOCAL` or `ADDRESS`.
    seed
        Decides what is killed when.
    task_s
        How long tasks take: a kill comes within that time of the beginning of one.
    """

    def __init__(self, ground: Ground, place: str, seed: int, task_s: float = TASK_S) -> None:
        self.ground = ground
        self.kills: list[Killed] = []
        self.moments: list[dict[str, Any]] = []
        self.exit_codes: list[int] = []
        self._chance = random.Random(seed)
        self._place = place
        self._task_s = task_s
        self._port = free_port()
        self._scheduler: subprocess.Popen[bytes] | None = None
        self._driver: subprocess.Popen[bytes] | None = None
        self._workers: list[subprocess.Popen[bytes]] = []

    def disturb(self, what: Sequence[str]) -> None:
        """Run, kill these one after the other, and run until all is made."""
        with Watcher(self.ground) as self.watcher:
            try:
                if self._place == ADDRESS:
                    self._start_scheduler()
                    self._workers = [
                        self._start("-c", WORKER_SCRIPT, self._address, "--nthreads", "1") for _ in "ab"
                    ]
                for index, kind in enumerate(what):
                    self._kill_one(kind, len(what) - index)
                self._finish(len(what))
            finally:
                self._end()

    def verdict(self, undisturbed: Mapping[str, str]) -> dict[str, Any]:
        """Return what is wrong with what was made, each entry empty where nothing is."""
        digests = self.ground.digests()
        return {
            "products_missing": sorted(undisturbed.keys() - digests.keys()),
            "products_that_differ": sorted(
                name for name, digest in digests.items() if undisturbed.get(name) != digest
            ),
            "finished_work_redone": redone(self.ground, self.ground.executions(), self.watcher.whole_since),
            "begun_again_without_a_kill": self._unexplained(),
            "half_written": self.watcher.broken,
            "processes_left": [process.pid for process in self._left],
            "files_left": self.ground.litter(),
            "runs_ended_by_a_kill_they_should_survive": self._failed_runs(),
        }

    def record(self) -> dict[str, Any]:
        """Return what was done."""
        return {
            "place": self._place,
            "kills": [
                {**moment, **asdict(killed)} for moment, killed in zip(self.moments, self.kills, strict=True)
            ],
            "executions": len(self.ground.executions()),
            "works": len(self.ground.works),
            "exit_codes": self.exit_codes,
            "products_read_by_the_watcher": self.watcher.reads,
            "files_left_to_the_next_run": self._litter,
        }

    @property
    def _address(self) -> str:
        return f"tcp://127.0.0.1:{self._port}"

    def _start_scheduler(self) -> None:
        command = (
            "-m",
            "dask",
            "scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            str(self._port),
            "--dashboard-address",
            "127.0.0.1:0",
        )
        self._scheduler = self.ground.start(*command)

    def _running_driver(self) -> subprocess.Popen[bytes]:
        if self._driver is not None and self._driver.poll() is not None:
            self.exit_codes.append(self._driver.returncode)
            self._driver = None
        if self._driver is None:
            environment = {"OBJECTFOLDER_CLUSTER": self._address} if self._place == ADDRESS else {}
            self._driver = self._start(**environment)
        return self._driver

    def _start(self, *arguments: str, **environment: str) -> subprocess.Popen[bytes]:
        return self.ground.start(*arguments, environment={"PATIENCE": str(LONGER), **environment})

    def _kill_one(self, kind: str, kills_left: int) -> None:
        """Kill at a random moment of the remaining work, so that the other kills have their share of it."""
        while True:
            driver = self._running_driver()
            begun = len(self.ground.executions())
            left = len(self.ground.works) - len({execution.work for execution in self.ground.executions()})
            more = self._chance.randint(1, max(1, left // kills_left))
            self._wait_for_tasks(begun + more, driver)
            delay_s = self._chance.uniform(0.0, self._task_s)
            with contextlib.suppress(subprocess.TimeoutExpired):
                driver.wait(delay_s)
            if driver.poll() is not None:
                return  # it ended before the moment came
            candidates = self._candidates(kind, driver)
            if not candidates:
                continue
            with contextlib.suppress(psutil.NoSuchProcess):
                self.kills.append(kill(self.ground, kind, self._chance.choice(candidates)))
                stood = sum(map(self.ground.stands, self.ground.works))  # slow: not before the kill
                self.moments.append(
                    {"executions_begun": begun + more, "then_s": round(delay_s, 4), "finished": stood}
                )
                if kind == SCHEDULER:
                    self._start_scheduler()
                return

    def _wait_for_tasks(self, count: int, driver: subprocess.Popen[bytes]) -> None:
        """Wait until this number of tasks has begun, or the driver has ended."""
        wait_for(lambda: len(self.ground.executions()) >= count or driver.poll() is not None, "tasks begin")

    def _candidates(self, kind: str, driver: subprocess.Popen[bytes]) -> list[psutil.Process]:
        if kind in (DRIVER, SCHEDULER):
            process = driver if kind == DRIVER else self._scheduler
            assert process is not None
            assert process.poll() is None, f"the {kind} ended by itself"
            return [psutil.Process(process.pid)]
        processes = victims(self.ground, self._cut_short())
        keepers = {driver.pid} if self._place == LOCAL else {process.pid for process in self._workers}
        for worker in processes[WORKER]:
            with contextlib.suppress(psutil.NoSuchProcess):
                assert keepers & {parent.pid for parent in worker.parents()}, "a worker of another place"
        return processes[kind]

    def _cut_short(self) -> set[tuple[str, str]]:
        """Return what a kill of its own process cut short: a second one would count as its own fault."""
        return {work for killed in self.kills if killed.what == CHILD for work in killed.running}

    def _finish(self, kills: int) -> None:
        for _ in range(kills + MOST_RUNS):
            driver = self._running_driver()
            driver.wait(GENEROUS_S)
            if driver.returncode == 0:
                break
        self.exit_codes.append(self._driver.returncode if self._driver else -1)

    def _unexplained(self) -> dict[str, int]:
        """What a driver or scheduler elsewhere leaves behind may begin after it was killed."""
        if self._place == LOCAL or all(killed.what in SURVIVED for killed in self.kills):
            return unexplained(self.ground.executions(), self.kills)
        return {}

    def _failed_runs(self) -> list[int]:
        """A task that kills met twice fails, as it should: a spared one may begin before a kill arrives.

        A child that was killed between two tasks may have been handed one that had not yet begun.
        """
        children = [killed for killed in self.kills if killed.what == CHILD]
        met = Counter(work for killed in children for work in killed.running)
        most = max(met.values(), default=0) + any(not killed.running for killed in children)
        if all(killed.what in SURVIVED for killed in self.kills) and most < 2:
            return [code for code in self.exit_codes if code]
        return self.exit_codes[-1:] if self.exit_codes[-1] else []

    def _end(self) -> None:
        """End what is meant to run on, see what does not end, and tidy as the next run does."""
        for process in (*self._workers, self._scheduler):
            if process is not None:
                process.terminate()
        with contextlib.suppress(TimeoutError):
            wait_for(lambda: not self.ground.processes(), "all processes are gone", 60.0)
        self._left = self.ground.processes()
        self.ground.end()
        self._litter = self.ground.litter()
        if self._litter:
            self.ground.run()
            self.ground.start("-m", "pipeline.cli", "clean", "--yes").wait()


def undisturbed(ground: Ground) -> dict[str, str]:
    """Return the digests of all products, made without any disturbance."""
    if ground.run() != 0:
        raise AssertionError((ground.root / "output.log").read_text())
    assert set(ground.counts().values()) == {1}
    return ground.digests()


def free_port() -> int:
    """Return a port of this host that nobody listens on."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        port: int = listener.getsockname()[1]
        return port
