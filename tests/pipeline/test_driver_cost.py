"""What the driver of a run with very many tasks hands to Dask, and looks at."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from pipeline.cluster import dask_runner
from pipeline.cluster.places import Place
from pipeline.cluster.run_task import Answer
from pipeline.cluster.worker_plugin import MEMORY_BYTES
from pipeline.dataset.job import BLENDER, GPU, Job
from pipeline.dataset.task import Call, Outcome, Request

THREADS, HOSTS = 2, 3


class Future:
    """A task at the scheduler."""

    status = "finished"

    def __init__(self, object_id: str) -> None:
        self.object_id = object_id
        self.ends: Callable[[Future], None] = lambda _: None

    def add_done_callback(self, ends: Callable[["Future"], None]) -> None:
        self.ends = ends

    def result(self, timeout: float) -> Answer:
        return Answer("worker", "host", Outcome(self.object_id))

    def release(self) -> None:
        pass


class Client:
    """A scheduler with workers that begin nothing by themselves."""

    status = "running"

    def __init__(self) -> None:
        self.workers: dict[str, Any] = {}
        self.outstanding: list[Future] = []

    def scheduler_info(self, n_workers: int) -> Mapping[str, Any]:
        return {"workers": self.workers}

    def submit(self, task: Callable[..., Answer], call: Call, *rest: Any, **options: Any) -> Future:
        self.outstanding.append(Future(call.request.object_id))
        return self.outstanding[-1]


@pytest.fixture
def driver(tmp_path: Path) -> tuple[dask_runner.DaskRunner, Client]:
    """A runner whose workers have threads for `THREADS` tasks each, and no GPU."""
    client = Client()
    runner = dask_runner.DaskRunner(client, tmp_path, Place(pools_within_s=0.0))
    resources = {runner._plugin.name: THREADS, MEMORY_BYTES: 8e9, BLENDER: 1}
    client.workers = {str(host): {"resources": resources, "nthreads": THREADS} for host in range(HOSTS)}
    return runner, client


def job(name: str, path_seconds: float, needs: frozenset[str] = frozenset()) -> Job:
    call = Call("views", "", Request(name, {}, {}, {}, 0), (), "", {})
    return Job(call, path_seconds=path_seconds, memory_bytes=10**9, needs=needs)


def test_dask_has_a_few_tasks_a_thread_and_the_most_urgent_first(driver, monkeypatch):
    monkeypatch.setattr(dask_runner, "FEWEST_TASKS", 3)
    runner, client = driver
    runner._workers.look()
    for index in reversed(range(500)):
        runner.submit(job(f"{index:03}", float(index)))
    ends = runner.finished(lambda busy, total: None)
    most = dask_runner.TASKS_A_THREAD * THREADS * HOSTS
    ran = []
    while client.outstanding:
        assert len(client.outstanding) <= most
        future = client.outstanding.pop(0)
        future.ends(future)
        ran.append(next(ends).job.object_id)
        if len(ran) == 10:
            runner.submit(job("urgent", 1e6))
        runner._begin_waiting()
    assert ran.index("urgent") <= 10 + most  # behind those that Dask had, before the hundreds that wait
    assert [name for name in ran if name != "urgent"] == [f"{index:03}" for index in reversed(range(500))]
    assert next(ends, None) is None


def test_tasks_that_wait_fail_as_others_where_no_worker_can_run_them(driver, monkeypatch):
    monkeypatch.setattr(dask_runner, "FEWEST_TASKS", 1)
    monkeypatch.setattr(dask_runner, "TASKS_A_THREAD", 0)
    runner, _ = driver
    for index in range(5):
        runner.submit(job(str(index), 0.0, frozenset({GPU})))
    ends = list(runner.finished(lambda busy, total: None))
    assert sorted(end.job.object_id for end in ends) == list("01234")
    assert all(f"no worker offers {GPU}" in end.outcome.failure.error for end in ends)
