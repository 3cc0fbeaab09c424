"""The worker command: it works, ends with all it started, and leaves nothing behind."""

import argparse
import contextlib
import os
import signal

import psutil
import pytest
from processes import command, eventually, job, kill, run, scheduler

from objectfolder.errors import InputError
from pipeline.cluster import worker
from pipeline.cluster.cluster import runner
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
        with runner(Place(kind="address", address=address), toys.root, 3) as started:
            (end,) = run(started, job(toys, "good"))
            assert started.largest_bytes() == 2e9
            litter = "poison import time; open('litter', 'w').close(); time.sleep(600)"
            started.submit(job(toys, "still", litter))
            eventually(lambda: list(scratch.rglob("litter")))
            (before,) = scratch.rglob("litter")
            # A worker that is killed takes its child along, and what that left; its task begins anew.
            port = end.worker.rpartition(":")[2]
            for one in psutil.Process(process.pid).children(recursive=True):
                with contextlib.suppress(psutil.NoSuchProcess, ProcessLookupError):  # taken along already
                    if any(str(c.laddr.port) == port for c in one.net_connections()):
                        os.kill(one.pid, signal.SIGKILL)
            eventually(lambda: not before.exists())
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
        with runner(Place(kind="address", address=address), toys.root, 3) as started:
            started.submit(job(toys, "still", "poison import time; time.sleep(600)"))
            eventually((toys.root / "executed.log").exists)
            offspring = psutil.Process(process.pid).children(recursive=True)
            kill(process)
            assert psutil.wait_procs(offspring, timeout=60)[1] == []
