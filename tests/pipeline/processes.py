"""Schedulers and workers as processes of their own, as the commands start them."""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
from toys import REPOSITORY, Toys

from pipeline.dataset.job import Finished, Job, Runner
from pipeline.dataset.task import Call, Request
from tests.patience import wait_until

LIMIT_S = float(os.environ.get("OBJECTFOLDER_TEST_LIMIT_S", "180"))


def job(toys: Toys, name: str, body: str = "1.0", needs: frozenset[str] = frozenset()) -> Job:
    """A job of the toys' first stage; `body` is the mesh, poison included."""
    toys.add(name, body)
    request = Request(name, {"mesh": toys.rows[name]["mesh"]}, {}, {}, 0)
    call = Call("ingest", toys.ingest.task, request, toys.ingest.targets(toys.root, name), "0" * 64, {})
    return Job(call, needs=needs)


def run(runner: Runner, *jobs: Job) -> list[Finished]:
    """Run jobs to their ends; return these, in the order of the jobs."""
    for task in jobs:
        runner.submit(task)
    ends = {end.job.object_id: end for end in runner.finished(lambda running, threads: None)}
    return [ends[task.object_id] for task in jobs]


@contextlib.contextmanager
def running(runner: Runner, *jobs: Job) -> Iterator[list[Finished]]:
    """Run jobs in another thread meanwhile; yield their ends, complete when the context ends well."""
    ends: list[Finished] = []
    with ThreadPoolExecutor(1) as pool:
        thread = pool.submit(lambda: ends.extend(run(runner, *jobs)))
        yield ends
        thread.result(LIMIT_S)


def eventually(condition: Callable[[], object], limit_s: float = LIMIT_S) -> None:
    wait_until(condition, patience_s=limit_s)


@contextlib.contextmanager
def command(folder: Path, name: str, *arguments: str, **environment: str) -> Iterator[subprocess.Popen]:
    """Run ``dask NAME ...`` in a folder until the context ends; its output is in ``NAME.log``."""
    path = os.pathsep.join([str(REPOSITORY), os.environ.get("PYTHONPATH", "")])
    with open(folder / f"{name}.log", "a") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", name, *arguments],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": path, **environment},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        offspring = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
        process.terminate()
        try:
            process.wait(60)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for left in psutil.wait_procs(offspring, timeout=30)[1]:
            left.kill()


@contextlib.contextmanager
def scheduler(folder: Path, port: int = 0, *arguments: str) -> Iterator[tuple[str, subprocess.Popen]]:
    """Run a scheduler; yield its address and its process."""
    log = folder / "scheduler.log"
    mark = "Scheduler at:"
    marks = log.read_text().count(mark) if log.exists() else 0
    options = ("--host", "127.0.0.1", "--port", str(port), "--dashboard-address", "127.0.0.1:0", *arguments)
    with command(folder, "scheduler", *options) as process:

        def address() -> str:
            assert process.poll() is None, log.read_text()
            lines = [line for line in log.read_text().splitlines() if mark in line]
            return lines[-1].split()[-1] if len(lines) > marks else ""

        eventually(address)
        yield address(), process


def worker(
    folder: Path, address: str, *arguments: str, **environment: str
) -> contextlib.AbstractContextManager[subprocess.Popen]:
    """Run a worker with one thread, with variables of its environment."""
    options = ("--nworkers", "1", "--nthreads", "1", "--memory-limit", "0", "--no-dashboard", *arguments)
    return command(folder, "worker", address, *options, **environment)


def kill(process: subprocess.Popen) -> None:
    process.send_signal(signal.SIGKILL)
    process.wait()


def make_certificate(file: Path) -> Path:
    """Make a certificate with its key as docs/cluster.md says."""
    openssl = "openssl req -x509 -newkey rsa:2048 -nodes -days 1 -subj /CN=objectfolder"
    subprocess.run([*openssl.split(), "-keyout", file, "-out", file], check=True, capture_output=True)
    file.chmod(0o600)
    return file
