"""How well Dask orders the tasks of a hundred scans, and what a task costs beside its own work.

    python -m bench scale [--tasks 10000] [--seconds 45]

The measured seconds and memory of a hundred scans (``known_costs.csv``) go through the real scheduler,
workers and driver as tasks that sleep. All times are divided by one number, so that the lower bound takes
`--seconds`: the longer of work / threads and the longest chain of one object. Priorities come from the
seconds themselves, or from the means of stages, as in a first run.

Empty tasks show the CPU seconds and the memory that driver and scheduler take. In both, a function that
sleeps stands in place of a task's child process.
"""

import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import psutil

from bench.record import REPOSITORY, arguments, conclude
from pipeline.cluster import dask_runner
from pipeline.cluster.cluster import settings
from pipeline.cluster.places import Place
from pipeline.cluster.run_task import Answer
from pipeline.dataset.job import BLENDER, Job
from pipeline.dataset.stages import STAGES
from pipeline.dataset.task import Call, Outcome, Request
from pipeline.run.costs import read_costs
from pipeline.run.estimates import Estimate, Estimates, last_costs

KNOWN = Path(__file__).with_name("known_costs.csv")
# Few of the scans have costs of the stage of collision parts.
FOLLOWED = {name: stage for name, stage in STAGES.items() if name != "collision"}
CLUSTERS = ((1, 2), (1, 8), (8, 8))  # workers, and threads of each
MEMORY_GB_A_THREAD = 8.0
COMPARED = (
    "Wall seconds of the tasks of a hundred scans, asleep, over the lower bound; CPU milliseconds of driver "
    "and scheduler a task, and growth of the driver's memory"
)
Costs = Mapping[tuple[str, str], Estimate]  # by object and stage


def main() -> None:
    parser = arguments("order of tasks, and their cost beside their work")
    parser.add_argument("--tasks", type=int, default=10_000, help="empty tasks")
    parser.add_argument("--seconds", type=float, default=45.0, help="that the lower bound is scaled to")
    options = parser.parse_args()
    os.environ["PYTHONPATH"] = str(REPOSITORY)  # of scheduler and workers
    with mock.patch.object(dask_runner, "run_task", sleep):
        figures: dict[str, Any] = {"empty_tasks": empty_tasks(options.tasks)}
        print(figures["empty_tasks"], flush=True)
        costs = last_costs(read_costs(KNOWN))
        figures["makespans"] = []
        for workers, threads in CLUSTERS:
            with cluster(workers, threads) as (runner, _):
                for knowledge, expected in (("known", costs), ("first", means(costs))):
                    row = makespan(runner, workers * threads, costs, expected, options.seconds)
                    row = {"knowledge": knowledge, "workers": workers, "threads_of_each": threads, **row}
                    figures["makespans"].append(row)
                    print(row, flush=True)
    surroundings = {"processors": os.cpu_count(), "load": os.getloadavg()[0]}
    conclude("scale", figures, surroundings, COMPARED)


def sleep(call: Call, *rest: Any) -> Answer:
    """Sleep as long as a call says, in place of `pipeline.cluster.run_task.run_task`."""
    time.sleep(call.request.parameters["seconds"])
    return Answer("", "", Outcome(call.request.object_id))


def means(costs: Costs) -> Costs:
    """Return what is expected of each task where nothing of the data set ran."""
    estimates = Estimates(Path(os.devnull))
    return {(object_id, stage): estimates.of(stage, object_id) for object_id, stage in costs}


def chain_s(costs: Costs, object_id: str, stage: str) -> float:
    """Return the seconds of a stage and of the longest chain behind it."""
    behind = [name for name, follower in FOLLOWED.items() if stage in follower.follows]
    longest = max((chain_s(costs, object_id, name) for name in behind), default=0.0)
    return costs[object_id, stage].cpu_s + longest


def makespan(
    runner: dask_runner.DaskRunner, threads: int, costs: Costs, expected: Costs, bound_s: float
) -> dict[str, Any]:
    """Run all objects; return how long it took, beside the bound, in seconds of the bench."""
    objects = sorted({object_id for object_id, _ in costs})
    chain = max(chain_s(costs, object_id, "objects") for object_id in objects)
    work = sum(cost.cpu_s for (_, stage), cost in costs.items() if stage in FOLLOWED)
    scale = max(work / threads, chain) / bound_s
    done: dict[str, set[str]] = {object_id: set() for object_id in objects}
    begun: set[tuple[str, str]] = set()

    def ready(object_id: str) -> Iterator[Job]:
        for stage, declared in FOLLOWED.items():
            key = object_id, stage
            if key not in begun and set(declared.follows) <= done[object_id]:
                begun.add(key)
                cost = expected[key]
                request = Request(object_id, {}, {"seconds": costs[key].cpu_s / scale}, {}, 0)
                yield Job(
                    Call(stage, "", request, (), "", {}),
                    cost.cpu_s,
                    chain_s(expected, *key),
                    cost.memory_bytes,
                    declared.needs,
                )

    first = [job for object_id in objects for job in ready(object_id)]
    begin = time.perf_counter()
    for job in sorted(first, key=lambda job: job.path_seconds, reverse=True):
        runner.submit(job)
    for ended in runner.finished(lambda running, total: None):
        done[ended.job.object_id].add(ended.job.call.stage)
        for job in ready(ended.job.object_id):
            runner.submit(job)
    wall = time.perf_counter() - begin
    assert all(names == set(FOLLOWED) for names in done.values())
    return {
        "times_divided_by": scale,
        "bound_s": bound_s,
        "wall_s": wall,
        "over_bound": wall / bound_s,
    }


def empty_tasks(count: int) -> dict[str, float]:
    """Return what driver and scheduler spend on a task that does nothing."""
    request = Request("", {}, {"seconds": 0.0}, {}, 0)
    jobs = [
        Job(Call("empty", "", replace(request, object_id=f"o{index}"), (), "", {}), 1.0, 1.0, 10**8)
        for index in range(count + 100)
    ]
    with cluster(1, 2) as (runner, client):
        scheduler, driver = psutil.Process(client.run_on_scheduler(os.getpid)), psutil.Process()
        for job in jobs[:100]:
            runner.submit(job)
        assert sum(1 for _ in runner.finished(lambda running, total: None)) == 100
        memory = driver.memory_info().rss
        before = [cpu_s(process) for process in (driver, scheduler)]
        begin = time.perf_counter()
        for job in jobs[100:]:
            runner.submit(job)
        ends = sum(end.outcome.failure is None for end in runner.finished(lambda running, total: None))
        wall = time.perf_counter() - begin
        assert ends == count
        spent = [cpu_s(process) - s for process, s in zip((driver, scheduler), before, strict=True)]
        return {
            "tasks": count,
            "tasks_a_second": count / wall,
            "driver_cpu_ms_a_task": 1e3 * spent[0] / count,
            "scheduler_cpu_ms_a_task": 1e3 * spent[1] / count,
            "driver_memory_growth_mb": (driver.memory_info().rss - memory) / 1e6,
        }


@contextmanager
def cluster(workers: int, threads: int) -> Iterator[tuple[dask_runner.DaskRunner, Any]]:
    """Start scheduler and workers as processes of their own, and a runner on them."""
    from distributed import Client
    from distributed.deploy.subprocess import SubprocessCluster

    with (
        settings(),
        tempfile.TemporaryDirectory() as folder,
        SubprocessCluster(
            n_workers=workers,
            worker_kwargs={"nthreads": threads, "resources": {BLENDER: 1}, "memory_limit": 0},
            scheduler_kwargs={"dashboard": False},
        ) as started,
        Client(started, set_as_default=False) as client,
    ):
        client.wait_for_workers(workers)
        place = Place(workers_within_s=300.0, memory_gb=MEMORY_GB_A_THREAD * threads)
        with dask_runner.DaskRunner(client, Path(folder), place) as runner:
            yield runner, client


def cpu_s(process: psutil.Process) -> float:
    """Return the CPU seconds of a process so far."""
    times = process.cpu_times()
    return float(times.user + times.system)
