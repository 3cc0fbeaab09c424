"""Tasks that grow: ended before their host suffers, whichever of their processes it is, and they alone."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import psutil
import pytest
from test_isolation import calls_of

from pipeline.sandbox import host_memory
from pipeline.sandbox.isolation import Child, ChildSettings
from pipeline.sandbox.memory_watch import LONGEST_PAUSE_S, SHORTEST_PAUSE_S, MemoryWatch, proportional_bytes
from pipeline.sandbox.process_tree import descendants
from tests.patience import wait_until

LIMIT_BYTES = 400_000_000
# Each ends by itself where nobody ends it, well above the limit, so that a test that fails harms nobody.
# As fast as data are read, 0.2 GB/s: the watch looks many times before the limit is doubled, on a busy
# machine too. What only touches memory takes milliseconds.
GROWING = "import time; held = [(time.sleep(0.02), b'x' * (4 << 20)) for _ in range(300)]"
SLOW = f"{GROWING}; raise OSError('nobody minded')"
ONE_STEP = "held = b'x' * (1 << 30); raise OSError('nobody minded')"
IN_A_CHILD = (
    f"import subprocess, sys; subprocess.run([sys.executable, '-c', {f'{GROWING}; time.sleep(60)'!r}]); "
    "raise OSError('nobody minded')"
)
BRIEF = "held = b'x' * (250 << 20)"
HOLD_120_MB = "import time; held = b'x' * (120 << 20); time.sleep(60)"
SPREAD = (
    "import subprocess; subprocess.run(['sh', '-c', 'for i in 1 2 3 4; do \"$0\" -c \"$1\" & done; wait', "
    f"{sys.executable!r}, {HOLD_120_MB!r}]); raise OSError('nobody minded')"
)


# One step takes its 1.07 GB in less time than a busy machine needs for a look: it has no such bound.
MOST_BYTES = {
    SLOW: 2 * LIMIT_BYTES,
    ONE_STEP: float("inf"),
    IN_A_CHILD: 2 * LIMIT_BYTES,
    SPREAD: 2 * LIMIT_BYTES,
}


@pytest.mark.slow
def test_tasks_that_grow_beyond_their_limit_are_ended_and_the_next_one_runs(toys):
    (good,) = calls_of(toys, ["good"])
    with Child(toys.root, ChildSettings(memory_limit_bytes=LIMIT_BYTES)) as child:
        for body, most_bytes in MOST_BYTES.items():
            (grows,) = calls_of(toys, ["grows"], {"grows": body})
            begin = time.monotonic()
            outcome = child.run(grows)
            assert time.monotonic() - begin < 55, body
            assert "used more than 0.4 GB" in outcome.failure.error, body
            assert "memory_limit_bytes" in outcome.failure.remedy
            assert LIMIT_BYTES < outcome.peak_bytes < most_bytes, body
            assert child._process is None
        assert child.run(good).failure is None


@pytest.mark.slow
def test_peak_counts_what_a_task_started(toys):
    body = IN_A_CHILD.replace("range(300)", "range(40)").replace("sleep(60)", "sleep(1)")
    small, starts = calls_of(toys, ["small", "starts"], {"starts": body})
    with Child(toys.root, ChildSettings()) as child:
        alone = child.run(small).peak_bytes
        for _ in range(2):  # the second time it is no new largest child
            assert child.run(starts).peak_bytes > alone + (160 << 20)


@pytest.mark.slow
def test_peak_counts_a_process_that_ended_before_anybody_looked(toys, monkeypatch):
    monkeypatch.setattr(MemoryWatch, "look", lambda *_: None)
    body = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {BRIEF!r}], check=True)"
    small, starts = calls_of(toys, ["small", "starts"], {"starts": body})
    with Child(toys.root, ChildSettings()) as child:
        assert child.run(small).peak_bytes < 250 << 20 < child.run(starts).peak_bytes


@pytest.fixture
def holder():
    """A process with a child that holds 400 MiB."""
    inner = "import sys; held = b'x' * (400 << 20); print('held', flush=True); sys.stdin.read()"
    script = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {inner!r}])"
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "held\n"
    yield process
    process.communicate()


@pytest.mark.slow
def test_where_the_host_runs_short_only_what_is_above_its_estimate_ends(holder):
    def look(expected_mb, left):
        return MemoryWatch(holder.pid, None, expected_mb * 10**6, lambda: left).look("mug")

    little, much = host_memory.total_bytes() // 100, host_memory.total_bytes() // 10
    failure = look(50, little)
    assert failure.error.startswith("used 0.4")
    assert "in one process" in failure.error
    assert "left" in failure.error
    assert "fewer workers" in failure.remedy
    assert look(50, much) is None
    assert look(300, little) is None
    assert look(0, little) is None


def test_shared_memory_counts_once():
    script = (
        "import os, sys, time\n"
        "held = b'x' * (200 << 20)\n"
        "if os.fork() == 0: time.sleep(300)\n"
        "if os.fork() == 0: time.sleep(300)\n"
        "print('held', flush=True); sys.stdin.read(); os.killpg(0, 9)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout.readline() == "held\n"
    pids = [process.pid, *descendants(process.pid)]
    resident = sum(psutil.Process(pid).memory_info().rss for pid in pids)
    assert len(pids) == 3
    assert resident > 600 << 20
    assert 200 << 20 < proportional_bytes(pids) < 300 << 20
    watch = MemoryWatch(psutil.Process().pid, 500_000_000)
    assert watch.look("mug") is None
    assert watch.peak_bytes > 600 << 20
    process.communicate()


def test_looks_come_faster_as_room_runs_out(holder):
    def pause(limit):
        watch = MemoryWatch(holder.pid, limit)
        watch._begin -= 100.0  # a long task
        watch.look("mug")
        return watch.pause_s

    assert pause(450 << 20) < pause(4 << 30) <= LONGEST_PAUSE_S
    assert pause(450 << 20) >= SHORTEST_PAUSE_S


def test_a_control_group_counts_where_it_is_smaller_than_the_host(tmp_path, monkeypatch):
    for name, text in (
        ("memory.max", "1000000000\n"),
        ("memory.current", "700000000\n"),
        ("memory.stat", "anon 500000000\ninactive_file 150000000\n"),
    ):
        (tmp_path / name).write_text(text)
    names = [tmp_path / name for name in ("memory.max", "memory.current", "memory.stat", "memory.events")]
    group = host_memory._Group(*names, "inactive_file")
    monkeypatch.setattr(host_memory, "_groups", lambda: (group,))
    assert host_memory.total_bytes() == 1_000_000_000
    assert host_memory.available_bytes() == 450_000_000


def test_only_kills_in_the_own_control_group_count_as_out_of_memory(tmp_path, monkeypatch):
    """Not those of the host, nor of a group around it, where another's process may have died."""
    groups = []
    for name, kills in (("own", 2), ("outer", 7)):
        (tmp_path / name).write_text(f"low 0\noom {kills}\noom_kill {kills}\n")
        none = tmp_path / "none"
        groups.append(host_memory._Group(none, none, none, tmp_path / name, ""))
    monkeypatch.setattr(host_memory, "_all_groups", lambda: iter(groups))
    assert host_memory.out_of_memory_kills() == 2
    monkeypatch.setattr(host_memory, "_all_groups", lambda: iter([]))
    assert host_memory.out_of_memory_kills() == 0


GROUPED = """
import sys
sys.path[:0] = {folders!r}
from pathlib import Path
from test_isolation import calls_of
from toys import Toys
from pipeline.sandbox.isolation import Child, ChildSettings

toys = Toys(Path.cwd(), {package!r})
(call,) = calls_of(toys, ["grows"], {{"grows": {body!r}}})
with Child(Path.cwd(), ChildSettings(memory_limit_bytes=1 << 40)) as child:
    failure = child.run(call, {expected}).failure
print(failure.error, failure.remedy, sep="\\n")
"""


def _empty(control_group):
    return not (control_group / "cgroup.procs").read_text().split()


@pytest.fixture
def control_group():
    """A control group of 1 GB for a process, where this user may make one.

    It keeps out of swap, where the host has some: what is swapped out is not killed.
    """
    for base, limit, swap in (
        (Path("/sys/fs/cgroup/memory"), "memory.limit_in_bytes", "memory.swappiness"),
        (Path("/sys/fs/cgroup"), "memory.max", "memory.swap.max"),
    ):
        folder = base / f"objectfolder-test-{os.getpid()}"
        if not (base / "cgroup.procs").exists():
            continue
        try:
            folder.mkdir()
        except OSError:
            continue
        try:
            (folder / limit).write_text(str(10**9))
            if (folder / swap).exists():  # not where the kernel has no swap
                (folder / swap).write_text("0")
        except OSError:
            folder.rmdir()
            continue
        yield folder
        wait_until(partial(_empty, folder))
        folder.rmdir()
        return
    pytest.skip("no control group can be made here (needs root, and the memory controller)")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("expected", "finding", "remedy"),
    [
        (0, "more than its part, when its host had only", "fewer workers"),
        (1 << 40, "killed by the system, which had run out of memory", "fewer workers"),
    ],
    ids=["watched", "killed by the kernel"],
)
def test_in_a_control_group(toys, control_group, expected, finding, remedy):
    script = GROUPED.format(
        folders=[str(Path(__file__).parents[depth]) for depth in (0, 2)],
        package=toys.package,
        body=SLOW,
        expected=expected,
    )
    command = f'echo $$ > {control_group}/cgroup.procs && exec {sys.executable} -c "$0"'
    for _ in range(3):
        done = subprocess.run(
            ["sh", "-c", command, script], cwd=toys.root, capture_output=True, text=True, check=False
        )
        if done.returncode != -signal.SIGKILL:
            break
        # Before the memory of the task is free, a busy kernel may end another process of the group, too.
        wait_until(partial(_empty, control_group))
    assert done.returncode == 0, done.stderr
    assert finding in done.stdout
    assert remedy in done.stdout
