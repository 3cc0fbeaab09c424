"""A run that is killed at any moment loses nothing finished and leaves nothing half-written."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from toys import FILES, QUALITY, TUNED

from pipeline import products

OBJECTS = 24


@pytest.mark.slow
def test_killed_at_any_moment_and_run_again(toys):
    toys.rows.clear()
    for index in range(OBJECTS):
        toys.add(f"object_{index:02}", f"{index}.5")
    toys.set_parameter("training_views", 120)  # milliseconds a tune takes
    (toys.root / "cluster").mkdir()
    (toys.root / "cluster" / "local.yaml").write_text("workers: 2\n")
    toys.save()
    toys.converge(toys.ingest)
    toys.executed()
    chance = random.Random(7)
    finished: set[str] = set()
    executions: list[str] = []
    for _ in range(10):
        _run_and_kill(toys.root, chance.uniform(0.2, 4.0))
        executions += toys.executed()
        now = _whole_products(toys.root, TUNED)
        assert finished <= now  # nothing finished is lost
        finished = now
    _run_and_kill(toys.root, 60.0)
    executions += toys.executed()
    assert len(_whole_products(toys.root, TUNED)) == OBJECTS
    assert not list(toys.root.glob("data/*/.*.partial"))
    # Each object once, and again only what was running when a kill came: two workers, ten kills.
    assert OBJECTS <= len(executions) <= OBJECTS + 2 * 10
    toys.converge(toys.tune)
    assert toys.executed() == []


def test_killed_between_the_two_kinds_of_a_stage(toys, monkeypatch):
    toys.converge()
    toys.executed()
    monkeypatch.setenv("OBJECTFOLDER_MEMO_GB", "0")
    toys.converge()
    # What a kill after the first of two commits leaves: one new file, one of before.
    old = QUALITY.path(toys.root, "cup").read_bytes()
    toys.rows["cup"]["material"] = {"stiffness": 9.0}
    toys.converge()
    QUALITY.path(toys.root, "cup").write_bytes(old)
    toys.executed()
    toys.converge()
    assert toys.executed() == ["encode cup"]
    files = [kind.path(toys.root, "cup") for kind in (FILES, QUALITY)]
    assert len({products.read_fingerprint(path) for path in files}) == 1


def _run_and_kill(root: Path, seconds: float) -> None:
    process = subprocess.Popen(
        [sys.executable, "driver.py", "tune"], cwd=root, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        offspring = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGKILL)
        process.wait()
        _, alive = psutil.wait_procs(offspring, timeout=15)
        assert not alive, "processes outlived the run"


def _whole_products(root: Path, kind: products.ProductKind) -> set[str]:
    """Object ids of products that can be read; every file there is must be whole."""
    found = set()
    for path in (root / kind.folder).glob(f"*{kind.suffix}"):
        if not path.name.startswith("."):
            products.verify(path)
            assert products.read_fingerprint(path)
            found.add(path.name)
    return found


def test_interrupted_by_the_keyboard_ends_all_processes(toys):
    toys.set_parameter("training_views", 20000)
    toys.save()
    toys.converge(toys.ingest)
    process = subprocess.Popen(
        [sys.executable, "driver.py", "tune"],
        cwd=toys.root,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        # A shell lets its background jobs, and so these tests in one, ignore interrupts.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 20
    while not any("tune" in line for line in _log(toys.root)) and time.monotonic() < deadline:
        time.sleep(0.1)
    offspring = psutil.Process(process.pid).children(recursive=True)
    os.kill(process.pid, signal.SIGINT)
    process.wait(20)
    _, alive = psutil.wait_procs(offspring, timeout=15)
    assert not alive


def _log(root: Path) -> list[str]:
    path = root / "executed.log"
    return path.read_text().splitlines() if path.exists() else []
