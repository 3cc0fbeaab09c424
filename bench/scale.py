"""What a task costs beside its own work: 100,000 empty tasks, and 100,000 objects with nothing to do.

    python -m bench.scale [--tasks 100000] [--crew-tasks 20000] [--objects 20000]

Empty tasks go through plain Dask (`client.submit` of all at once), and through `pipeline.run.dispatch` and
the crew of Dask workers (each task in a child process, answers as events).
Scheduler, workers and driver are processes of their own; CPU seconds and resident memory are theirs,
messages and bytes are those of Dask's streams between them. Objects with nothing to do are planned by
`pipeline.run.flow`, first with nothing remembered and then again.

Then what many objects take, in proportion to the scans of ``pipeline/run/forecast/known_costs.csv``.
Prices are assumptions (`CPU_HOUR`, `GB_MONTH`).
"""

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from pipeline.dataset.crew import Job, Lost
from pipeline.run.dispatch import Dispatch

from bench.record import write
from objectfolder.tensor_file import TensorFile
from pipeline.dataset import products
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.products import TENSORS, ProductKind
from pipeline.dataset.stage import ProductInput, Stage
from pipeline.dataset.stages import STAGES
from pipeline.dataset.task import Call, Request
from pipeline.dataset.verified import Verified
from pipeline.run.flow import Flow
from pipeline.run.forecast.estimates import Estimates, packaged_costs

REPOSITORY = Path(__file__).parents[1]
WORKERS = 2
PROJECTED = (1000, 100_000, 10_000_000)
CPU_HOUR, GB_MONTH = 0.04, 0.023  # US dollars, of the order of list prices on demand in 2025
COMPARED = (
    "Empty tasks through plain Dask and through this project's dispatch and crew of Dask workers: CPU "
    "seconds, messages, bytes and memory a task; planning of objects that are as they should be: CPU seconds "
    "an object"
)


def main() -> None:
    parser = argparse.ArgumentParser(description="what a task costs beside its own work")
    parser.add_argument("--tasks", type=int, default=100_000, help="through plain Dask")
    parser.add_argument("--crew-tasks", type=int, default=20_000, help="through dispatch and workers")
    parser.add_argument("--objects", type=int, default=20_000, help="to plan")
    given = parser.parse_args()
    os.environ["PYTHONPATH"] = str(REPOSITORY)  # of scheduler, workers and children
    figures: dict[str, Any] = {}
    for name, measure, count in (
        ("plain_dask", plain_dask, given.tasks),
        ("dispatch_and_crew", through_crew, given.crew_tasks),
        ("planning", planning, given.objects),
    ):
        figures[name] = measure(count)
        print(name, json.dumps(figures[name]), flush=True)
    figures["projection"] = {str(count): projection(count) for count in PROJECTED}
    settings = {
        "workers": WORKERS,
        "assumed_price_of_a_cpu_hour": CPU_HOUR,
        "assumed_price_of_a_gb_month": GB_MONTH,
        "load_of_the_machine": os.getloadavg()[0],
    }
    write("scale", figures, settings, COMPARED)


def nothing(request: Request | None = None) -> tuple[()]:
    """The empty task."""
    return ()


def plain_dask(count: int) -> dict[str, Any]:
    from distributed import Client, wait
    from distributed.deploy.subprocess import SubprocessCluster

    with (
        SubprocessCluster(n_workers=WORKERS, worker_kwargs={"nthreads": 1}) as cluster,
        Client(cluster) as client,
    ):
        client.wait_for_workers(WORKERS)
        wait([client.submit(nothing, pure=False) for _ in range(100)])

        def run() -> None:
            wait([client.submit(nothing, key=f"empty-{index}", pure=False) for index in range(count)])

        return _observed(client, run, count)


def through_crew(count: int) -> dict[str, Any]:
    from distributed import Client
    from distributed.deploy.subprocess import SubprocessCluster

    from pipeline.cluster.cluster import crew, read_place

    with (
        tempfile.TemporaryDirectory() as folder,
        SubprocessCluster(n_workers=WORKERS, worker_kwargs={"nthreads": 1}) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        client.wait_for_workers(WORKERS)
        place = read_place(Path(folder), cluster.scheduler_address)
        with crew(place, Path(folder), count) as workers:
            _run_all(Dispatch(workers), [_job(f"warm{index}") for index in range(100)])
            jobs = [_job(f"o{index}") for index in range(count)]

            def run() -> None:
                _run_all(Dispatch(workers), jobs)

            return _observed(client, run, count)


def planning(count: int) -> dict[str, Any]:
    """An input and a product for each object, both as they should be."""
    made, wanted = ProductKind("data/made", TENSORS), ProductKind("data/wanted", TENSORS)
    stage = Stage("wanted", "pipeline.tasks.touches:press_sensor", (wanted,), inputs=(ProductInput(made),))
    parameters = read_parameters(REPOSITORY / "params.yaml")
    rows: dict[str, dict[str, Any]] = {f"o{index:07d}": {} for index in range(count)}
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for kind in (made, wanted):
            (root / kind.folder).mkdir(parents=True)
        tensors = TensorFile({"weights": np.arange(5, dtype=np.float16)}, {"format": "toy"})
        for object_id in rows:
            products.write(made.path(root, object_id), tensors, "a" * 64, {"task": "made"})
        first = _plan(root, stage, parameters, rows)
        from objectfolder.provenance import fingerprint

        verified = Verified(root)
        for object_id in rows:
            parts = stage.prepare(root, parameters, object_id, {}, verified).parts
            products.write(wanted.path(root, object_id), tensors, fingerprint(parts), {})
        fresh = _plan(root, stage, parameters, rows)
        again = _plan(root, stage, parameters, rows)
        assert (first["kept"], fresh["kept"], again["kept"]) == (0, count, count)
        return {
            "objects": count,
            "all_to_compute": first,
            "all_kept_nothing_remembered": fresh,
            "all_kept": again,
            "remembered_bytes_an_object": (root / ".objectfolder" / "verified.json").stat().st_size / count,
        }


def _plan(root: Path, stage: Stage, parameters: Any, rows: dict[str, dict[str, Any]]) -> dict[str, Any]:
    begin, before = time.process_time(), psutil.Process().memory_info().rss
    verified = Verified(root)
    flow = Flow([stage], root, parameters, rows, verified, lambda: Estimates(root, parameters))
    jobs = flow.begin()
    verified.save()
    return {
        "cpu_ms_an_object": (time.process_time() - begin) / len(rows) * 1e3,
        "bytes_an_object": (psutil.Process().memory_info().rss - before) / len(rows),
        "kept": len(rows) - len(jobs),
    }


def projection(count: int) -> dict[str, float]:
    """What so many objects take in all."""
    costs = packaged_costs()
    objects = len({one.object_id for one in costs})
    cpu_h = sum(one.cpu_s for one in costs) / objects / 3600
    gigabytes = sum(one.product_bytes for one in costs) / objects / 1e9
    return {
        "tasks": count * len(STAGES),
        "product_files": count * sum(len(stage.products) for stage in STAGES.values()),
        "cpu_hours": count * cpu_h,
        "cpu_price": count * cpu_h * CPU_HOUR,
        "gigabytes": count * gigabytes,
        "price_of_a_month_of_store": count * gigabytes * GB_MONTH,
    }


def _job(name: str) -> Job:
    call = Call("empty", "bench.scale:nothing", Request(name, {}, {}, {}, 0), (), f"{name:0>64}"[-64:], {})
    return Job(call, 1.0, 1.0, 10**8)


def _run_all(dispatch: Dispatch, jobs: list[Job]) -> None:
    for job in jobs:
        dispatch.add(job)
    for event in dispatch.events():
        if not isinstance(event, Lost) and event.outcome.failure is not None:
            raise RuntimeError(event.outcome.failure.error)


def _observed(client: Any, run: Callable[[], None], count: int) -> dict[str, Any]:
    """What driver and scheduler spent on a run, and what went between them and the workers."""
    scheduler = psutil.Process(client.run_on_scheduler(os.getpid))
    driver = psutil.Process()
    sent = _sent(client)
    before = [(_cpu(process), process.memory_info().rss) for process in (driver, scheduler)]
    begin = time.perf_counter()
    run()
    wall = time.perf_counter() - begin
    after = [(_cpu(process), process.memory_info().rss) for process in (driver, scheduler)]
    found: dict[str, Any] = {"tasks": count, "wall_s": wall, "tasks_a_second": count / wall}
    for name, (cpu, memory), (cpu_then, memory_then) in zip(
        ("driver", "scheduler"), after, before, strict=True
    ):
        found[f"{name}_cpu_ms_a_task"] = (cpu - cpu_then) / count * 1e3
        found[f"{name}_memory_growth_bytes"] = memory - memory_then
    for name, value in _sent(client).items():
        found[f"{name}_a_task"] = (value - sent[name]) / count
    return found


def _cpu(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _sent(client: Any) -> dict[str, float]:
    """Messages, batches and bytes sent so far on all streams between client, scheduler and workers."""

    def of_scheduler(dask_scheduler: Any) -> list[tuple[int, int, int]]:
        streams = [*dask_scheduler.stream_comms.values(), *dask_scheduler.client_comms.values()]
        return [(stream.message_count, stream.batch_count, stream.byte_count) for stream in streams]

    def of_worker(dask_worker: Any) -> tuple[int, int, int]:
        stream = dask_worker.batched_stream
        return stream.message_count, stream.batch_count, stream.byte_count

    own = client.scheduler_comm
    counts = [
        *client.run_on_scheduler(of_scheduler),
        *client.run(of_worker).values(),
        (own.message_count, own.batch_count, own.byte_count),
    ]
    names = ("messages", "batches", "bytes")
    return {name: float(sum(count[place] for count in counts)) for place, name in enumerate(names)}


if __name__ == "__main__":
    main()
