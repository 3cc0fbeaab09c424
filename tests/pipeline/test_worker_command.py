"""The worker command: it works, ends with all it started, and leaves nothing behind."""

import argparse
import contextlib
import os
import signal

import psutil
import pytest
from processes import command, eventually, job, kill, scheduler, until

from objectfolder.errors import InputError
from pipeline.cluster import worker
from pipeline.cluster.cluster import crew
from pipeline.cluster.places import Place


def parsed(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    worker.add_arguments(parser)
    return parser.parse_args(arguments)


def test_what_it_cannot_do_is_refused(tmp_path, monkeypatch):
    monkeypatch.delenv("OBJECTFOLDER_TLS", raising=False)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"authority\.pem: is missing.*Copy the folder"):
        worker.main(parsed("tls://127.0.0.1:1"))
    with pytest.raises(InputError, match=r"unknown pool 'rocket'. Known are blender, gpu, nothing"):
        worker._resources("gpu, rocket")
    assert worker._resources("gpu,blender") == {"gpu": 1.0, "blender": 1.0}
    assert worker._resources("nothing") == worker._resources("") == {"nothing": 1.0}
    assert worker._resources(None) is None


def test_it_leaves_when_the_scheduler_is_gone_for_longer_than_told(tmp_path):
    with command(tmp_path, "worker", "tcp://127.0.0.1:9", "--gone-after", "0") as process:
        assert process.wait(120) == 1
    assert "tcp://127.0.0.1:9: gone for" in (tmp_path / "worker.log").read_text()


@pytest.mark.slow
def test_it_ends_with_all_it_started_and_leaves_no_file(toys):
    scratch = toys.root / "scratch"
    with contextlib.ExitStack() as stack:
        address, _ = stack.enter_context(scheduler(toys.root))
        options = ("--workers", "1", "--scratch", str(scratch), "--memory-gb", "2")
        process = stack.enter_context(command(toys.root, "worker", address, *options))
        with crew(Place(kind="address", address=address), toys.root, 3) as running:
            until(running, lambda _: running.slots())
            assert list(running.memory_bytes().values()) == [2_000_000_000]
            (slot,) = running.slots()
            litter = "poison import time; open('litter', 'w').close(); time.sleep(600)"
            running.start(job(toys, "still", litter), slot)
            eventually(lambda: list(scratch.rglob("litter")))
            # A worker that is killed takes its child along, and what that left.
            for one in psutil.Process(process.pid).children(recursive=True):
                with contextlib.suppress(psutil.NoSuchProcess, ProcessLookupError):  # taken along already
                    if any(str(c.laddr.port) == slot.rpartition(":")[2] for c in one.net_connections()):
                        os.kill(one.pid, signal.SIGKILL)
            until(running, lambda events: events and running.slots())
            eventually(lambda: not list(scratch.rglob("litter")))
            (slot,) = running.slots()
            running.start(job(toys, "again", litter), slot)
            eventually(lambda: list(scratch.rglob("litter")))
            offspring = psutil.Process(process.pid).children(recursive=True)
            assert len(offspring) >= 3  # the worker, the guard, the child
            process.terminate()
            assert process.wait(60) == 0
            assert psutil.wait_procs(offspring, timeout=60)[1] == []
        assert [path for path in scratch.rglob("*") if path.is_file()] == []


@pytest.mark.slow
def test_a_worker_command_killed_takes_everything_with_it(toys):
    with contextlib.ExitStack() as stack:
        address, _ = stack.enter_context(scheduler(toys.root))
        process = stack.enter_context(command(toys.root, "worker", address, "--workers", "1"))
        with crew(Place(kind="address", address=address), toys.root, 3) as running:
            until(running, lambda _: running.slots())
            running.start(job(toys, "still", "poison import time; time.sleep(600)"), min(running.slots()))
            eventually((toys.root / "executed.log").exists)
            offspring = psutil.Process(process.pid).children(recursive=True)
            kill(process)
            assert psutil.wait_procs(offspring, timeout=60)[1] == []
            until(running, lambda events: events and not running.slots())
