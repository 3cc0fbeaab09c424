"""A crew of Dask workers: jobs end where they were put; workers and schedulers may go and come."""

import contextlib
import dataclasses
import os
import signal
import time

import psutil
import pytest
from processes import command, eventually, job, kill, scheduler, until

from objectfolder.errors import SimulationError
from pipeline.cluster.cluster import crew
from pipeline.cluster.dask_crew import GONE
from pipeline.cluster.places import Place
from pipeline.dataset.crew import GPU, Finished, Lost

STILL = "poison import time; time.sleep(600)"


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    """Two workers of this machine, for tests that leave them as they were."""
    from toys import Toys

    with pytest.MonkeyPatch.context() as patch:
        root = tmp_path_factory.mktemp("crew")
        patch.syspath_prepend(str(root))
        patch.setenv("PYTHONPATH", os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")]))
        made = Toys(root, "toys_of_crew")
        with crew(Place(workers=2), root, 4) as running:
            until(running, lambda _: len(running.slots()) == 2)
            yield made, running


def test_jobs_end_in_the_slots_they_were_put(local):
    toys, running = local
    slots = sorted(running.slots())
    assert len({slot.host for slot in running.slots().values()}) == 1
    assert min(running.memory_bytes().values()) > 1e8
    jobs = {slots[0]: job(toys, "good"), slots[1]: job(toys, "bad", "poison raise OSError('no')")}
    for slot, one in jobs.items():
        running.start(one, slot)
    ends = until(running, lambda events: len(events) == 2)
    assert {end.slot: end.job for end in ends} == jobs
    outcomes = {end.job.call.request.object_id: end.outcome for end in ends}
    assert outcomes["good"].failure is None
    assert outcomes["good"].cpu_s > 0
    assert outcomes["bad"].failure.error == "OSError: no"
    assert "Traceback" in outcomes["bad"].failure.detail


def test_a_child_killed_from_outside_is_a_loss_and_the_worker_stays(local):
    toys, running = local
    before = dict(running.slots())
    poison = job(toys, "killed", "poison import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    running.start(poison, min(before))
    (end,) = until(running, lambda events: events)
    assert end == Lost(poison, min(before), "its process was killed (SIGKILL)")
    assert running.slots() == before


def test_pools_that_nobody_offers(local):
    _, running = local
    (offers,) = {slot.offers for slot in running.slots().values()}
    assert running.may_still_offer(offers)
    running._patience = dataclasses.replace(running._patience, pools_s=0.0)
    assert not running.may_still_offer(frozenset({"submarine"}))
    assert running.wait() == []  # and so a dispatch learns of it


@pytest.mark.slow
def test_a_worker_killed_is_a_loss_and_another_takes_its_place(toys):
    with crew(Place(workers=2), toys.root, 4) as running:
        until(running, lambda _: len(running.slots()) == 2)
        doomed, other = sorted(running.slots())
        still = job(toys, "still", STILL)
        running.start(still, doomed)
        eventually(lambda: (toys.root / "executed.log").exists())
        os.kill(_worker_process(doomed), signal.SIGKILL)
        events = until(running, lambda events: events and len(running.slots()) == 2)
        assert [event for event in events if isinstance(event, Lost)] == [
            Lost(still, doomed, f"worker {doomed} went away", counts=False)
        ]
        assert other in running.slots()
        assert doomed not in running.slots()
        running.start(job(toys, "next"), (set(running.slots()) - {other}).pop())
        (end,) = until(running, lambda events: events)
        assert isinstance(end, Finished)


@pytest.mark.slow
def test_a_scheduler_that_returns_is_found_again_with_its_workers(toys):
    place = Place(kind="address", reconnect_s=120.0)
    with contextlib.ExitStack() as stack:
        address, first = stack.enter_context(scheduler(toys.root))
        port = int(address.rpartition(":")[2])
        stack.enter_context(command(toys.root, "worker", address, "--workers", "1", "--offers", GPU))
        running = stack.enter_context(crew(dataclasses.replace(place, address=address), toys.root, 3))
        until(running, lambda _: running.slots())
        assert {slot.offers for slot in running.slots().values()} == {frozenset({GPU})}
        still = job(toys, "still", STILL)
        running.start(still, min(running.slots()))
        eventually(lambda: (toys.root / "executed.log").exists())
        kill(first)
        stack.enter_context(scheduler(toys.root, port))
        events = until(running, lambda events: events and running.slots())
        assert events == [Lost(still, events[0].slot, GONE, counts=False)]
        running.start(job(toys, "next"), min(running.slots()))
        (end,) = until(running, lambda events: events)
        assert isinstance(end, Finished)
        assert end.outcome.failure is None


def test_a_scheduler_that_does_not_return_ends_the_run(toys):
    with contextlib.ExitStack() as stack:
        address, process = stack.enter_context(scheduler(toys.root))
        place = Place(kind="address", address=address, reconnect_s=1.0)
        running = stack.enter_context(crew(place, toys.root, 3))
        kill(process)
        with pytest.raises(SimulationError, match=r"the scheduler went away.*nothing finished is lost"):
            until(running, lambda events: False)


def test_no_scheduler_and_no_workers_are_said_so(toys):
    gone = Place(kind="address", address="tcp://127.0.0.1:9", reconnect_s=0.5)
    with pytest.raises(SimulationError, match="no scheduler answers"), crew(gone, toys.root, 3):
        pass
    with scheduler(toys.root) as (address, _):
        empty = Place(kind="address", address=address, workers_within_s=0.5)
        with crew(empty, toys.root, 3) as running, pytest.raises(SimulationError, match="no worker for"):
            until(running, lambda events: False)


@pytest.mark.slow
def test_the_child_of_a_driver_that_is_gone_ends(toys):
    with contextlib.ExitStack() as stack:
        address, _ = stack.enter_context(scheduler(toys.root))
        stack.enter_context(command(toys.root, "worker", address, "--workers", "1"))
        place = Place(kind="address", address=address)
        with crew(place, toys.root, 3) as running:
            until(running, lambda _: running.slots())
            body = f"poison import os; open({str(toys.root / 'pid')!r}, 'w').write(str(os.getpid())); "
            running.start(job(toys, "still", body + STILL.partition(" ")[2]), min(running.slots()))
            eventually(lambda: (toys.root / "pid").exists() and (toys.root / "pid").read_text())
            pid = int((toys.root / "pid").read_text())
            assert psutil.pid_exists(pid)
        eventually(lambda: not psutil.pid_exists(pid))
        with crew(place, toys.root, 3) as running:
            until(running, lambda _: running.slots())
            begun = time.monotonic()
            running.start(job(toys, "next"), min(running.slots()))
            (end,) = until(running, lambda events: events)
            assert isinstance(end, Finished)
            assert time.monotonic() - begun < 300  # not after the sleep of the one given up


def _worker_process(address: str) -> int:
    """Return the process that listens at an address."""
    port = int(address.rpartition(":")[2])
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if any(
                one.status == psutil.CONN_LISTEN and one.laddr.port == port
                for one in process.net_connections()
            ):
                return process.pid
    raise AssertionError(f"nobody listens at {address}")
