"""Jobs on Dask workers: what the scheduler is asked to respect, and what dies under it."""

import contextlib
import dataclasses
import itertools
import os
import time
from pathlib import Path

import dask
import psutil
import pytest
from processes import eventually, job, kill, run, running, scheduler, worker

from objectfolder.errors import SimulationError
from pipeline.cluster.cluster import runner
from pipeline.cluster.places import Place
from pipeline.dataset.job import GPU, Job
from pipeline.dataset.project_files import DASHBOARD

STILL = "poison import time; time.sleep(600)"
TWO = Place(kwargs={"threads_per_worker": 2}, memory_gb=4.0)
KILL_WORKER = (
    "poison import os, psutil; "
    "[p.kill() for p in psutil.Process().parents() if 'spawn_main' in ' '.join(p.cmdline())][:1]; "
    "import time; time.sleep(60)"
)


def times(root: Path, name: str) -> tuple[float, float]:
    """When a job of `noted` began and ended."""
    begin, end = (root / f"{name}.times").read_text().split()
    return float(begin), float(end)


def noted(toys, name: str, seconds: float = 0.3, **expected: object) -> Job:
    """A job that writes down when it ran."""
    path = str(toys.root / f"{name}.times")
    body = (
        f"begin = time.time(); time.sleep({seconds}); open({path!r}, 'w').write(f'{{begin}} {{time.time()}}')"
    )
    template = job(toys, name, f"poison {body}\n1.0")
    return dataclasses.replace(template, **expected)


def end_workers() -> None:
    """Kill the workers of this process."""
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):  # it may have ended meanwhile
            if "spawn_main" in " ".join(process.cmdline()):
                process.kill()


def overlap(root: Path, first: str, second: str) -> bool:
    """Whether two jobs ran at the same time."""
    (begin, end), (other_begin, other_end) = times(root, first), times(root, second)
    return begin < other_end and other_begin < end


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    """Two threads of this machine, for tests that leave them as they were."""
    from toys import Toys

    with pytest.MonkeyPatch.context() as patch:
        root = tmp_path_factory.mktemp("runner")
        patch.syspath_prepend(str(root))
        patch.setenv("PYTHONPATH", os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")]))
        data_set = Toys(root, "toys_of_runner")
        with runner(TWO.model_copy(update={"pools_within_s": 1.0}), root, 4) as started:
            yield data_set, started


def test_an_error_of_a_task_is_its_outcome(local):
    toys, started = local
    good, bad = run(started, job(toys, "good"), job(toys, "bad", "poison raise OSError('no')"))
    assert good.outcome.failure is None
    assert good.outcome.cpu_s > 0
    assert good.host
    assert bad.outcome.failure.error == "OSError: no"
    assert "Traceback" in bad.outcome.failure.detail


def test_a_task_whose_process_is_killed_once_is_tried_again_alone(local):
    toys, started = local
    mark = toys.root / "killed_once"
    once = f"mark = Path({str(mark)!r}); first = not mark.exists(); mark.touch(); "
    once += "first and os.kill(os.getpid(), 9)"
    path = str(toys.root / "victim.times")
    body = f"import os; {once}; begin = time.time(); time.sleep(0.5); "
    body += f"open({path!r}, 'w').write(f'{{begin}} {{time.time()}}')\n1.0"
    neighbours = [noted(toys, f"other_{index}", 0.5, memory_bytes=10**8) for index in range(6)]
    victim, *rest = run(started, job(toys, "victim", f"poison {body}"), *neighbours)
    assert victim.tries == 2
    assert victim.outcome.failure is None
    assert not any(end.outcome.failure for end in rest)
    assert not any(overlap(toys.root, "victim", neighbour.object_id) for neighbour in neighbours)


def test_the_longest_chain_runs_first_and_memory_is_kept(local):
    toys, started = local
    shape = {f"sized_{index}": (index, (index % 3 + 1) * 10**9) for index in range(8)}
    jobs = [
        noted(toys, name, 0.4, path_seconds=float(seconds), memory_bytes=memory)
        for name, (seconds, memory) in shape.items()
    ]
    assert not any(end.outcome.failure for end in run(started, *jobs))
    spans = {name: times(toys.root, name) for name in shape}
    for begin, _ in spans.values():
        total_bytes = sum(shape[name][1] for name, (first, last) in spans.items() if first <= begin < last)
        assert total_bytes <= 4 * 10**9
    # The first two begin before the others are known; two that begin at once may say so in either order.
    begins = [spans[f"sized_{index}"][0] for index in range(2, 8)]
    assert all(longer <= shorter + 0.2 for shorter, longer in itertools.pairwise(begins))


@pytest.mark.slow
def test_a_task_larger_than_any_worker_runs_alone_on_the_largest(local):
    toys, started = local
    small = [noted(toys, f"small_{index}", path_seconds=1.0, memory_bytes=10**8) for index in range(4)]
    giant = noted(toys, "giant", path_seconds=2.0, memory_bytes=10**15)
    assert not any(end.outcome.failure for end in run(started, *small, giant))
    assert not any(overlap(toys.root, "giant", neighbour.object_id) for neighbour in small)


@pytest.mark.slow
def test_a_task_that_no_worker_can_run_is_refused_and_the_rest_goes_on(local):
    toys, started = local
    dive = dataclasses.replace(job(toys, "dive"), needs=frozenset({"submarine"}))
    refused, plain = run(started, dive, job(toys, "plain"))
    assert plain.outcome.failure is None
    assert refused.outcome.failure.error == "no worker offers submarine"
    assert refused.outcome.failure.remedy


@pytest.mark.slow
def test_what_kills_its_worker_fails_alone(toys, capfd):
    """Tasks that ran or waited on the worker that dies run again."""
    jobs = [job(toys, "poison", KILL_WORKER), *(job(toys, f"good_{index}") for index in range(3))]
    with dask.config.set({"distributed.scheduler.allowed-failures": 1}), runner(TWO, toys.root, 4) as started:
        poison, *good = run(started, *jobs)
        link = (toys.root / DASHBOARD).read_text()
        end_workers()  # Dask asks workers at the end of a run; one that is gone is no failure
    assert link.startswith("http")
    assert f"Dask's dashboard: {link}\n" in capfd.readouterr().err
    assert not (toys.root / DASHBOARD).exists()
    assert "workers died under it" in poison.outcome.failure.error
    assert not any(end.outcome.failure for end in good)


@pytest.mark.slow
def test_no_scheduler_is_said_so(toys):
    gone = Place(address="tcp://127.0.0.1:9", reconnect_s=0.5)
    with pytest.raises(SimulationError, match="no scheduler answers"), runner(gone, toys.root, 3):
        pass


@pytest.mark.slow
def test_a_cluster_elsewhere_loses_a_driver_and_then_its_scheduler(toys):
    with contextlib.ExitStack() as stack:
        address, process = stack.enter_context(scheduler(toys.root))
        empty = Place(address=address, workers_within_s=0.5)
        with runner(empty, toys.root, 3) as started, pytest.raises(SimulationError, match="no worker for"):
            run(started, job(toys, "good"))

        # The child of a driver that is gone ends, and the worker is free for the next.
        stack.enter_context(worker(toys.root, address, "--resources", f"{GPU}=1"))
        place = Place(address=address)
        body = f"poison import os; open({str(toys.root / 'pid')!r}, 'w').write(str(os.getpid())); "
        with runner(place, toys.root, 3) as started:
            still = job(toys, "still", body + STILL.partition(" ")[2])
            started.submit(dataclasses.replace(still, needs=frozenset({GPU})))
            eventually(lambda: (toys.root / "pid").exists() and (toys.root / "pid").read_text())
            pid = int((toys.root / "pid").read_text())
            assert psutil.pid_exists(pid)
        eventually(lambda: not psutil.pid_exists(pid))
        with runner(place, toys.root, 3) as started:
            begun = time.monotonic()
            (end,) = run(started, job(toys, "next"))
            assert end.outcome.failure is None
            assert time.monotonic() - begun < 300  # not after the sleep of the one given up

            # Without its scheduler a run ends.
            toys.executed()

            def run_until_killed() -> None:
                with running(started, job(toys, "still", STILL)):
                    eventually(lambda: (toys.root / "executed.log").exists())
                    kill(process)

            with pytest.raises(SimulationError, match=r"the scheduler went away.*nothing finished is lost"):
                run_until_killed()
