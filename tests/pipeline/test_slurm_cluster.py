"""Workers in jobs of a real Slurm of one node, with munge: they come with work and go with it."""

import gc
import os
import subprocess
import time
from pathlib import Path

import pytest
from processes import eventually
from services import need
from slurm import PROGRAMS, slurm

from objectfolder.errors import SimulationError
from pipeline.cluster import starting
from pipeline.cluster.cluster import connect
from pipeline.cluster.places import Adapt, Place

QUICK = {
    "distributed.adaptive.interval": "500ms",
    "distributed.adaptive.wait-count": 4,
    "distributed.deploy.lost-worker-timeout": "1s",
    "distributed.scheduler.allowed-failures": 3,
}


@pytest.fixture(autouse=True, scope="module")
def _jobqueue():
    pytest.importorskip("dask_jobqueue")


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    need(*PROGRAMS)
    with slurm(tmp_path_factory.mktemp("slurm")) as variables:
        yield variables


@pytest.fixture
def commands(environment, monkeypatch):
    for name in ("PATH", "SLURM_CONF"):
        monkeypatch.setenv(name, environment[name])


def place(most: int, **kwargs) -> Place:
    job = {"cores": 1, "memory": "1 GB", "walltime": "00:10:00", "scheduler_options": {"host": "127.0.0.1"}}
    return Place(
        module="dask_jobqueue",
        class_name="SLURMCluster",
        adapt=Adapt(maximum=most),
        kwargs={**job, **kwargs},
        dask=QUICK,
    )


def jobs() -> list[str]:
    queue = subprocess.run(
        ["squeue", "--noheader", "--format=%i"], capture_output=True, text=True, check=True
    )
    return queue.stdout.split()


@pytest.mark.slow
@pytest.mark.release("pipeline.cluster", "cluster")
def test_jobs_come_with_work_and_go_without_it(commands, tmp_path):
    with connect(place(3), tmp_path, 12) as client:
        assert client.scheduler.address.startswith("tls://127.0.0.1:")
        assert jobs() == []
        sleeps = client.map(time.sleep, [3.0] * 12, pure=False)
        eventually(lambda: len(client.scheduler_info()["workers"]) == 3)
        assert client.submit(os.getenv, "OBJECTFOLDER_WORKER_MEMORY_GB").result() == "0.9"
        assert client.submit(os.getcwd).result() == str(tmp_path)
        client.gather(sleeps)
        del sleeps
        eventually(lambda: not client.scheduler_info()["workers"] and not jobs())
        assert client.submit(sum, [1, 2]).result() == 3  # and come again
    eventually(lambda: not jobs())
    gc.collect()
    state = tmp_path / ".objectfolder"
    assert {path.name for path in state.iterdir()} == {"jobs", "keys"}
    assert list((state / "keys").iterdir()) == []


def stays_the_first_time(mark: Path) -> str:
    if not mark.exists():
        mark.touch()
        time.sleep(600)
    return os.environ["SLURM_JOB_ID"]


@pytest.mark.slow
@pytest.mark.release("pipeline.cluster", "cluster")
def test_a_job_that_reaches_its_walltime_is_replaced_and_its_task_runs_again(commands, tmp_path, monkeypatch):
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join([*(str(Path(__file__).parents[depth]) for depth in (0, 2)), *_path()])
    )
    with connect(place(1, walltime="00:01:00"), tmp_path, 1) as client:
        task = client.submit(stays_the_first_time, tmp_path / "mark")
        eventually((tmp_path / "mark").exists)
        (first,) = jobs()
        assert int(task.result()) > int(first)


@pytest.mark.slow
@pytest.mark.release("pipeline.cluster", "cluster")
def test_a_job_that_is_cancelled_before_its_worker_comes_is_replaced(commands, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(starting, "LOOK_S", 1.0)
    prologue = ["test -e there || { touch there; sleep 600; }"]
    with connect(place(1, job_script_prologue=prologue), tmp_path, 1) as client:
        task = client.submit(sum, [1, 2])
        eventually((tmp_path / "there").exists)
        subprocess.run(["scancel", *jobs()], check=True)
        assert task.result(timeout=180) == 3
    assert list((tmp_path / ".objectfolder" / "keys").iterdir()) == []
    assert "ended before it came; started again" in capfd.readouterr().err


def _path() -> list[str]:
    return [path for path in [os.environ.get("PYTHONPATH")] if path]


@pytest.mark.slow
@pytest.mark.release("pipeline.cluster", "cluster")
def test_a_job_that_slurm_refuses_ends_the_run_with_its_words(commands, tmp_path):
    with (
        pytest.raises(SimulationError, match="invalid partition"),
        connect(place(1, queue="no"), tmp_path, 5),
    ):
        pass


def test_without_slurm_the_run_says_where_to_go(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SimulationError, match="login node"), connect(place(1), tmp_path, 5):
        pass
