"""A run any part of which is killed at any moment loses nothing finished and leaves nothing half-written."""

import functools
import os
import signal
import subprocess
import sys

import psutil
import pytest
from disturbed import ADDRESS, CHILD, DRIVER, LOCAL, SCHEDULER, WORKER, Round
from ground import PACKAGE, Ground, wait_for
from toys import FILES, QUALITY
from workshop import forget

from pipeline.dataset import products


@pytest.fixture(scope="module")
def ground(tmp_path_factory):
    """A function of a number of objects: their data set, and digests of what an undisturbed run makes."""

    def contents(objects: int) -> dict[str, str]:
        return {f"object_{index:02}": f"{index}.5" for index in range(objects)}

    @functools.cache
    def expected(objects: int) -> dict[str, str]:
        reference = Ground(tmp_path_factory.mktemp("undisturbed") / "data_set", contents(objects))
        forget(PACKAGE)
        with pytest.MonkeyPatch.context() as patch:
            patch.syspath_prepend(str(reference.root))
            reference.toys.flow()  # in this process: what runs elsewhere must come out the same
        return reference.digests()

    def data_set(objects: int) -> tuple[Ground, dict[str, str]]:
        root = tmp_path_factory.mktemp("disturbed") / "data_set"
        return Ground(root, contents(objects)), expected(objects)

    return data_set


RELEASE = pytest.mark.release("pipeline.run", "pipeline.cluster", "pipeline.sandbox")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("objects", "place", "what"),
    [
        pytest.param(3, LOCAL, [CHILD, WORKER], id="run that survives"),
        pytest.param(3, LOCAL, [DRIVER], id="driver", marks=RELEASE),
        pytest.param(6, LOCAL, [DRIVER, CHILD, DRIVER], id="driver twice", marks=RELEASE),
        pytest.param(6, ADDRESS, [CHILD, SCHEDULER, WORKER, DRIVER], id="scheduler", marks=RELEASE),
    ],
)
def test_killed_at_random_moments(ground, objects, place, what):
    data_set, expected = ground(objects)
    disturbed = Round(data_set, place, seed=7)
    try:
        disturbed.disturb(what)
    finally:
        print((data_set.root / "output.log").read_text())
    assert disturbed.kills
    assert {name: findings for name, findings in disturbed.verdict(expected).items() if findings} == {}
    assert disturbed.watcher.reads >= len(expected)


def test_killed_between_the_two_kinds_of_a_stage(toys):
    toys.converge()
    toys.executed()
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


@pytest.mark.slow
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
    log = toys.root / "executed.log"
    wait_for(lambda: log.exists() and "tune" in log.read_text(), "a task begins")
    offspring = psutil.Process(process.pid).children(recursive=True)
    os.kill(process.pid, signal.SIGINT)
    process.wait(60)
    _, alive = psutil.wait_procs(offspring, timeout=60)
    assert not alive
