"""Tasks that crash, exit, hang or chatter harm themselves alone, and leave no process behind."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from objectfolder.products.provenance import code_identity
from pipeline.dataset.task import Call, Request
from pipeline.sandbox import host_memory, isolation, scratch
from pipeline.sandbox.isolation import Child, ChildSettings, Interrupted, ProcessKilled
from pipeline.sandbox.process_tree import descendants, end_with_variable
from tests.patience import wait_until

POISON = {
    "segfault": "import ctypes; print('last words', flush=True); ctypes.string_at(0)",
    "exit": "import sys; sys.exit(3)",
    "os_exit": "import os; os._exit(4)",
    "error": "raise KeyError('lost')",
    "system": "import subprocess; subprocess.run(['true']); print('chatter on stdout'); raise OSError('no')",
    "flood": "import os; os.write(1, b'x' * 100_000); raise OSError('flooded')",
}
EXPECTED = {
    "segfault": "crashed (SIGSEGV)",
    "exit": "exit(3)",
    "os_exit": "ended (exit 4)",
    "error": "KeyError: 'lost'",
    "system": "OSError: no",
    "flood": "OSError: flooded",
}
SLEEPER = "import subprocess; sleeper = subprocess.Popen(['sleep', '300'])"
# As native code may: a process in a session of its own, whose parent is gone.
ORPHAN = "import subprocess; subprocess.run(['sh', '-c', 'setsid sleep 300 & echo $! > orphan'])"
HANG = f"{SLEEPER}; {ORPHAN}; sleeper.wait()"
PATIENCE_S = 60.0


def calls_of(toys, names, poison=POISON, parts=None):
    for name in names:
        toys.add(name, f"poison {poison[name]}" if name in poison else "1.0")
    return [
        Call(
            "ingest",
            toys.ingest.task,
            Request(name, {"mesh": toys.rows[name]["mesh"]}, {}, {}, 0),
            toys.ingest.targets(toys.root, name),
            "0" * 64,
            parts or {},
        )
        for name in names
    ]


def alive(pid):
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def guard_of(child):
    return child._process.pid


@pytest.mark.slow
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
    assert len(toys.executed()) == len(names)


@pytest.mark.slow
@pytest.mark.parametrize("victim", ["task", "guard"])
def test_killed_from_outside_is_told_apart_from_failing(toys, victim):
    killed, good = calls_of(toys, ["killed", "good"], {"killed": f"{SLEEPER}; sleeper.wait()"})
    with Child(toys.root, ChildSettings()) as child:
        assert child.run(good).failure is None
        guard = guard_of(child)
        (task,) = descendants(guard)
        killer = threading.Thread(
            target=lambda: _kill_when_it_has_a_child(task, {"guard": guard}.get(victim, task))
        )
        killer.start()
        with pytest.raises(ProcessKilled, match="SIGKILL"):
            child.run(killed)
        killer.join()
        assert child.run(good).failure is None
        assert guard_of(child) != guard
    assert not alive(guard)
    assert not alive(task)


def _kill_when_it_has_a_child(task, victim):
    wait_until(lambda: descendants(task), "the task has started something")
    os.kill(victim, signal.SIGKILL)


def test_what_a_killed_guard_leaves_is_ended_too(toys):
    (call,) = calls_of(toys, ["long"], {"long": HANG})
    with Child(toys.root, ChildSettings()) as child:
        pids: set[int] = set()

        def kill():
            pids.update(_when_all_run(child))
            os.kill(guard_of(child), signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        with pytest.raises(ProcessKilled):
            child.run(call)
        killer.join()
    assert len(pids) >= 4
    wait_until(lambda: not any(map(alive, pids)), "all processes are gone")


def test_the_next_run_ends_what_a_driver_and_its_guard_left(toys, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    script = (
        "import os, subprocess; from pipeline.sandbox.scratch import Scratch; mine = Scratch(); "
        "left = subprocess.Popen(['sleep', '300'], env={**os.environ, 'TMPDIR': mine.name}, "
        "start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL); "
        "print(left.pid, flush=True); os._exit(0)"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    assert alive(int(done.stdout))
    Child(toys.root, ChildSettings()).__exit__(None, None, None)
    wait_until(lambda: not alive(int(done.stdout)), "it is gone")


def test_a_process_ends_that_took_the_number_of_another(tmp_path):
    with subprocess.Popen(["sleep", "300"], env={**os.environ, "TMPDIR": str(tmp_path)}) as process:
        (listing,) = (item for item in psutil.process_iter() if item.pid == process.pid)
        listing._ident = (process.pid, 0.0)  # as psutil has it of one that ended
        end_with_variable("TMPDIR", str(tmp_path))
        was_alive = alive(process.pid)
        process.kill()
    assert not was_alive


@pytest.mark.slow
def test_a_child_killed_while_idle_is_no_ones_loss(toys):
    first, second = calls_of(toys, ["first", "second"])
    with Child(toys.root, ChildSettings()) as child:
        child.run(first)
        (task,) = descendants(guard_of(child))
        os.kill(task, signal.SIGKILL)
        wait_until(lambda: child._process.poll() is not None, "the guard follows its task")
        assert child.run(second).failure is None


@pytest.mark.slow
def test_interrupted_by_another_thread(toys):
    (call,) = calls_of(toys, ["long"], {"long": f"{SLEEPER}; sleeper.wait()"})
    with Child(toys.root, ChildSettings()) as child:

        def interrupt():
            wait_until(lambda: child._process and len(descendants(guard_of(child))) == 2, "the task runs")
            child.interrupt()

        thread = threading.Thread(target=interrupt)
        thread.start()
        with pytest.raises(Interrupted):
            child.run(call)
        thread.join()
        toys.add("long", "1.0")
        assert child.run(call).failure is None


def test_tasks_work_in_a_scratch_folder_that_goes(toys):
    poison = {"litter": "from pathlib import Path; Path('left_behind').write_text('x'); 1 / 0"}
    with Child(toys.root, ChildSettings()) as child:
        (call,) = calls_of(toys, ["litter"], poison)
        assert "ZeroDivisionError" in child.run(call).failure.error
        folder = Path(child._scratch.name)
        assert folder.parent == scratch.home()
        assert (folder / "left_behind").exists()
    assert not folder.exists()
    assert not (toys.root / "left_behind").exists()


def test_hung_task_is_ended_with_what_it_started(toys, monkeypatch):
    (call,) = calls_of(toys, ["hang"], {"hang": HANG})
    with Child(toys.root, ChildSettings(time_limit_s=3.0)) as child:
        pids: set[int] = set()
        watcher = threading.Thread(target=lambda: pids.update(_when_all_run(child)))
        # On a busy machine the task starts its processes after the limit; so time passes from then on only.
        clock = SimpleNamespace(monotonic=lambda: 0.0 if watcher.is_alive() else time.monotonic())
        monkeypatch.setattr(isolation, "time", clock)
        watcher.start()
        outcome = child.run(call)
        watcher.join()
    assert "no answer within 3 s" in outcome.failure.error
    assert len(pids) >= 3
    assert not any(map(alive, pids))


def _when_all_run(child):
    """Return a task's processes once the orphan is among them."""
    orphan = Path(child._scratch.name, "orphan")
    wait_until(lambda: orphan.exists() and orphan.read_text().strip(), "the orphan has started")
    pid = int(orphan.read_text())
    return {
        *wait_until(lambda: _with(pid, descendants(guard_of(child))), "the orphan was adopted"),
        guard_of(child),
    }


def _with(pid, pids):
    return pids if pid in pids else []


@pytest.mark.parametrize(
    "end", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name
)
def test_whoever_dies_leaves_no_process_and_no_folder(toys, end):
    script = (
        "import signal, sys\n"
        # Whoever started the tests may have had them ignore it, as `nohup` does.
        "signal.signal(signal.SIGHUP, signal.SIG_DFL)\n"
        f"sys.path[:0] = {[str(Path(__file__).parents[depth]) for depth in (0, 2)]!r}\n"
        "from pathlib import Path\n"
        "from test_isolation import HANG, calls_of\n"
        "from toys import Toys\n"
        "from pipeline.sandbox.isolation import Child, ChildSettings\n"
        f"toys = Toys(Path.cwd(), {toys.package!r})\n"
        "(call,) = calls_of(toys, ['hang'], {'hang': HANG})\n"
        "child = Child(Path.cwd(), ChildSettings())\n"
        "print(child._scratch.name, flush=True)\n"
        "child.run(call)\n"
    )
    starter = subprocess.Popen(
        [sys.executable, "-c", script],
        cwd=toys.root,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    folder = type(toys.root)(starter.stdout.readline().strip())
    orphan = folder / "orphan"
    wait_until(lambda: orphan.exists() and orphan.read_text().strip(), "the orphan has started")
    # Starter, guard, task, sleeper and the orphan that left its session.
    running = {
        starter.pid,
        *wait_until(lambda: _with(int(orphan.read_text()), descendants(starter.pid)), "adopted"),
    }
    assert len(running) >= 5
    starter.send_signal(end)
    starter.wait(PATIENCE_S)
    starter.stdout.close()
    wait_until(lambda: not any(map(alive, running)), "all processes are gone")
    assert folder in scratch.sweep()
    assert not folder.exists()


def test_folders_of_dead_owners_are_swept_and_others_left(toys, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    script = (
        "import os; from pipeline.sandbox.scratch import Scratch; "
        "mine = Scratch(); print(mine.name, flush=True); os._exit(0)"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    left = type(tmp_path)(done.stdout.strip())
    foreign = scratch.home() / "another-host~1~0.00~task-x"
    notes = scratch.home() / "notes"
    for folder in (foreign, notes):
        folder.mkdir()
    mine = scratch.Scratch()
    assert scratch.abandoned() == [left]
    Child(toys.root, ChildSettings()).__exit__(None, None, None)
    assert not left.exists()
    assert Path(mine.name).exists()
    assert foreign.exists()
    assert notes.exists()
    mine.cleanup()
    assert not Path(mine.name).exists()


def test_children_are_replaced_after_some_tasks(toys):
    names = ["a", "b", "c", "d"]
    poison = dict.fromkeys(names, "import os; raise OSError(f'pid {os.getpid()}')")
    with Child(toys.root, ChildSettings(recycle_after=2)) as child:
        errors = [child.run(call).failure.error for call in calls_of(toys, names, poison)]
    assert errors[0] == errors[1] != errors[2] == errors[3]


def test_children_that_keep_memory_between_tasks_are_replaced(toys):
    names = ["small", "leaks", "after"]
    poison = dict.fromkeys(names, "import os; raise OSError(f'pid {os.getpid()}')")
    poison["leaks"] = "import os, sys; sys.leak = b'x' * (300 << 20); raise OSError(f'pid {os.getpid()}')"
    with Child(toys.root, ChildSettings(recycle_above_bytes=300 << 20)) as child:
        errors = [child.run(call).failure.error for call in calls_of(toys, names, poison)]
    assert errors[0] == errors[1] != errors[2]


@pytest.mark.slow
def test_children_whose_code_changed_are_replaced_and_code_that_keeps_changing_fails(toys):
    module = toys.ingest.task.partition(":")[0]
    with Child(toys.root, ChildSettings()) as child:
        (call,) = calls_of(toys, ["a"], parts={"code": code_identity(module)})
        assert child.run(call).failure is None
        guard = guard_of(child)
        assert child.run(call).failure is None
        assert guard_of(child) == guard
        toys.tasks.write_text(toys.tasks.read_text().replace("8, 300", "8, 301"))
        assert "the code of this stage changed" in child.run(call).failure.error
        (renewed,) = calls_of(toys, ["a"], parts={"code": code_identity(module)})
        assert child.run(renewed).failure is None
        assert guard_of(child) != guard


FILL = """
import ctypes, resource
heap = ctypes.CDLL(None)
heap.malloc.restype = ctypes.c_void_p
heap.free.argtypes = [ctypes.c_void_p]
def pages_of(arrays):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(arrays):
        array = heap.malloc(64 << 20)
        ctypes.memset(array, 1, 64 << 20)
        heap.free(array)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
first = pages_of(1)
raise OSError(f"{first} {pages_of(10)}")
"""
RESIDENT = "raise OSError(open('/proc/self/statm').read().split()[1])"


def test_arrays_of_a_task_take_the_same_memory_again_and_leave_it_at_the_end(toys, monkeypatch):
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")  # as Dask tells its workers
    poison = {"fills": f"exec({FILL!r}, {{}})", "rests": RESIDENT}
    with Child(toys.root, ChildSettings()) as child:
        fills, rests = (child.run(call).failure.error for call in calls_of(toys, poison, poison))
    first, again = map(int, fills.split()[-2:])
    assert again < first / 10  # an allocator that returns each array to the system has ten times `first`
    assert int(rests.split()[-1]) * os.sysconf("SC_PAGE_SIZE") < 200e6


def test_processes_of_a_task_find_the_code_of_the_task(toys):
    body = (
        "import subprocess, sys; raise OSError(subprocess.run([sys.executable, '-c', "
        f"'import {toys.package}; print({toys.package}.__file__)'], capture_output=True, text=True).stdout)"
    )
    (call,) = calls_of(toys, ["where"], {"where": body})
    with Child(toys.root, ChildSettings()) as child:
        assert str(toys.root / toys.package) in child.run(call).failure.error


def test_children_have_the_threads_they_are_given_and_die_before_others_when_memory_runs_out(
    toys, monkeypatch
):
    monkeypatch.setenv("MKL_CBWR", "COMPATIBLE")  # the user's choice, where tasks would have AVX2
    (call,) = calls_of(toys, ["a"])
    with Child(toys.root, ChildSettings(threads=3)) as child:
        child.run(call)
        (task,) = descendants(guard_of(child))
        environment = psutil.Process(task).environ()
        assert environment["OMP_NUM_THREADS"] == environment["NUMBA_NUM_THREADS"] == "3"
        assert environment["MKL_CBWR"] == "COMPATIBLE"
        if sys.platform == "linux":
            with open(f"/proc/{task}/oom_score_adj") as file, open("/proc/self/oom_score_adj") as own:
                assert int(file.read()) > int(own.read())


def test_a_kill_for_want_of_memory_is_recognised(toys, monkeypatch):
    (call,) = calls_of(toys, ["large"], {"large": "import os; os.kill(os.getpid(), 9)"})
    counts = iter([3, 4])
    monkeypatch.setattr(host_memory, "out_of_memory_kills", lambda: next(counts))
    with Child(toys.root, ChildSettings()) as child:
        failure = child.run(call).failure
    assert "killed by the system, which had run out of memory" in failure.error
    assert "fewer workers" in failure.remedy


def test_torch_is_not_imported_into_a_process_that_has_loaded_mkl(toys):
    """Its exponential would be MKL's there, and bits of a fit would hang on what ran before."""
    report = "import os; raise OSError(f'process {os.getpid()}')"
    packages = ("mkl", "mkl", "torch", "torch", "mkl")
    calls = [
        calls_of(toys, [f"task_{index}"], {f"task_{index}": report}, {"packages": {name: "1"}})[0]
        for index, name in enumerate(packages)
    ]
    with Child(toys.root, ChildSettings()) as child:
        processes = [child.run(call).failure.error for call in calls]
    assert processes[0] == processes[1] != processes[2] == processes[3] == processes[4]
