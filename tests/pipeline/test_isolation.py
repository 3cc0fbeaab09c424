"""Tasks that crash, exit, hang or chatter harm themselves alone."""

import os
import signal
import time

import pytest
from toys import python

from pipeline.cluster import Place, run_calls
from pipeline.isolation import Child, ChildSettings
from pipeline.task import Call, Request

POISON = {
    "kill": "import os, signal; os.kill(os.getpid(), signal.SIGKILL)",
    "segfault": "import ctypes; print('last words', flush=True); ctypes.string_at(0)",
    "exit": "import sys; sys.exit(3)",
    "os_exit": "import os; os._exit(4)",
    "error": "raise KeyError('lost')",
    "system": "import subprocess; subprocess.run(['true']); print('chatter on stdout'); raise OSError('no')",
}
EXPECTED = {
    "kill": "killed (SIGKILL)",
    "segfault": "crashed (SIGSEGV)",
    "exit": "exit(3)",
    "os_exit": "ended (exit 4)",
    "error": "KeyError: 'lost'",
    "system": "OSError: no",
}


def calls_of(toys, names, poison=POISON):
    for name in names:
        toys.add(name, f"poison {poison[name]}" if name in poison else "1.0")
    return [
        Call(
            "ingest",
            toys.ingest.task,
            Request(name, {"mesh": toys.rows[name]["mesh"]}, {}, {}, 0),
            toys.ingest.targets(toys.root, name),
            "0" * 64,
            {},
        )
        for name in names
    ]


def test_poison_fails_itself_and_nothing_else(toys):
    names = [name for poison in POISON for name in (poison, f"good_{poison}")]
    with Child(toys.root, ChildSettings()) as child:
        outcomes = {call.request.object_id: child.run(call) for call in calls_of(toys, names)}
    for name, outcome in outcomes.items():
        if name in EXPECTED:
            assert outcome.failure is not None
            assert EXPECTED[name] in outcome.failure.error
        else:
            assert outcome.failure is None
            assert outcome.cpu_s > 0
            assert outcome.peak_bytes > 1e6
    assert "last words" in outcomes["segfault"].failure.detail
    assert "KeyError" in outcomes["error"].failure.detail


def test_poison_on_the_cluster_fails_itself_and_nothing_else(toys):
    names = ["good_0", "kill", "good_1", "segfault", "good_2", "exit", "good_3", "good_4"]
    outcomes = list(run_calls(calls_of(toys, names), Place(workers=2), toys.root))
    assert sorted(outcome.object_id for outcome in outcomes) == sorted(names)
    failed = {outcome.object_id for outcome in outcomes if outcome.failure}
    assert failed == {"kill", "segfault", "exit"}
    assert len(toys.executed()) == len(names)


def test_a_running_scheduler_is_used_by_address(toys, monkeypatch):
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1, threads_per_worker=2, host="127.0.0.1", dashboard_address=None, memory_limit=0
    ) as cluster:
        monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", cluster.scheduler_address)
        outcomes = list(run_calls(calls_of(toys, ["good_0", "kill", "good_1"]), Place(), toys.root))
    assert {outcome.object_id: outcome.failure is None for outcome in outcomes} == {
        "good_0": True,
        "kill": False,
        "good_1": True,
    }


def test_tasks_work_in_a_scratch_folder(toys):
    poison = {"litter": "from pathlib import Path; Path('left_behind').write_text('x'); 1 / 0"}
    with Child(toys.root, ChildSettings()) as child:
        (call,) = calls_of(toys, ["litter"], poison)
        assert "ZeroDivisionError" in child.run(call).failure.error
    assert not (toys.root / "left_behind").exists()


def test_hung_task_is_ended_with_what_it_started(toys):
    marker = toys.root / "still_there"
    body = (
        f"import subprocess, time; subprocess.Popen(['sh', '-c', 'sleep 2; touch {marker}']); time.sleep(60)"
    )
    (call,) = calls_of(toys, ["hang"], {"hang": body})
    with Child(toys.root, ChildSettings(time_limit_s=1.0)) as child:
        outcome = child.run(call)
    assert "no answer within 1 s" in outcome.failure.error
    time.sleep(2.5)
    assert not marker.exists()


def test_children_are_replaced_after_some_tasks(toys):
    names = ["a", "b", "c", "d"]
    poison = dict.fromkeys(names, "import os; raise OSError(f'pid {os.getpid()}')")
    with Child(toys.root, ChildSettings(recycle_after=2)) as child:
        errors = [child.run(call).failure.error for call in calls_of(toys, names, poison)]
    assert errors[0] == errors[1] != errors[2] == errors[3]


def test_children_have_one_thread_and_no_parent_that_is_gone(toys):
    script = (
        "import os, sys, time\n"
        "from pathlib import Path\n"
        "from pipeline.isolation import Child, ChildSettings\n"
        "child = Child(Path.cwd(), ChildSettings())\n"
        "process = child._started()\n"
        "settings = Path(f'/proc/{process.pid}/environ').read_text()\n"
        "print(process.pid, settings.count('OMP_NUM_THREADS=1'), flush=True)\n"
        "time.sleep(0.5)\n"
        "os.kill(os.getpid(), 9)\n"
    )

    pid, found = map(int, python(toys.root, "-c", script).stdout.split())
    assert found == 1
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            os.kill(pid, signal.SIG_DFL)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    pytest.fail("the child outlived its parent")
