"""Tasks that crash, hang or eat all memory among others: they fail alone, with their reasons."""

from pathlib import Path

import pytest
from ground import Ground, wait_for

from pipeline.dataset.failures import read_failures

ENDING = {
    "segfault": ("os.kill(os.getpid(), 11)", "crashed (SIGSEGV)"),
    "null_read": ("import ctypes; ctypes.string_at(0)", "crashed (SIGSEGV)"),
    "abort": ("os.abort()", "crashed (SIGABRT)"),
    "os_exit": ("os._exit(4)", "ended (exit 4)"),
    "sys_exit": ("import sys; sys.exit(3)", "exit(3)"),
    "sigkill": ("os.kill(os.getpid(), 9)", "killed (SIGKILL)"),
}
TRIED_TWICE = {"sigkill"}  # whoever sent that, it need not be the object's fault
# A process that has left the session, so that only a search finds it.
STRAY = "import subprocess; subprocess.Popen(['sleep', '3600'], start_new_session=True)"
HANGING = {
    # Sleeps with the interpreter's lock in its hands.
    "holds_interpreter": "import ctypes, signal; signal.signal(15, signal.SIG_IGN); "
    "ctypes.PyDLL(None).sleep(3600)",
    "forks": f"{STRAY}; subprocess.Popen(['sleep', '3600']); time.sleep(3600)",
}
# Within it, a process of a task starts even where others have the processors for most of the time.
LIMIT_S = 30.0
RELEASE = pytest.mark.release("pipeline.cluster", "pipeline.sandbox")
MEMORY_LIMIT_BYTES = 700_000_000
# Ends by itself where nobody ends it, so that a test that fails harms nobody.
GREEDY = {
    "greedy": "held = [b'x' * (1 << 24) for _ in range(100)]; raise OSError('nobody minded')",
    "greedy_offspring": "import subprocess, sys; "
    "subprocess.run([sys.executable, '-c', "
    "\"import time; held = [b'x' * (1 << 24) for _ in range(100)]; time.sleep(20)\"]); "
    "raise OSError('nobody minded')",
}


def contents(poison: dict[str, str], good_each: int) -> dict[str, str]:
    """Return the poisonous objects, each after some good ones."""
    objects = {}
    for name, code in poison.items():
        objects.update({f"good_{index}_before_{name}": "1.5" for index in range(good_each)})
        objects[name] = f"poison {code}"
    return objects


def run(root: Path, poison: dict[str, str], good_each: int, **settings: object) -> dict[str, str]:
    """Run two stages over them on two workers; check what holds of every poison, return the reasons."""
    ground = Ground(root, contents(poison, good_each), **settings)
    try:
        assert ground.run(stages="ingest,tune") == 1
        wait_for(lambda: not ground.processes(), "all processes of the run are gone")
    finally:
        ground.end()
    failures = read_failures(root)
    assert [(failure.object, failure.stage) for failure in failures] == [
        (name, "ingest") for name in sorted(poison)
    ], [f"{failure.object}: {failure.error}" for failure in failures]
    counts = ground.counts()
    good = set(ground.toys.rows) - set(poison)
    assert len(good) == good_each * len(poison)
    assert counts == {
        **{("ingest", name): 2 if name in TRIED_TWICE else 1 for name in ground.toys.rows},
        **{("tune", name): 1 for name in good},
    }
    for name in ground.toys.rows:
        for stage in (ground.toys.ingest, ground.toys.tune):
            assert ground.stands((stage.name, name)) is (name in good)
    assert ground.litter() == []
    return {failure.object: failure.error for failure in failures}


def ends_alone(root: Path, names: set[str], good_each: int) -> None:
    poison = {**{name: code for name, (code, _) in ENDING.items()}, **HANGING}
    poison = {name: code for name, code in poison.items() if name in names}
    reasons = run(root, poison, good_each, time_limit_s=LIMIT_S)
    for name in names & ENDING.keys():
        assert ENDING[name][1] in reasons[name]
    for name in names & HANGING.keys():
        assert f"no answer within {LIMIT_S:g} s" in reasons[name]


@pytest.mark.slow
def test_tasks_that_crash_are_killed_or_hang(tmp_path):
    ends_alone(tmp_path / "data_set", {"segfault", "sigkill", "holds_interpreter"}, 1)


@pytest.mark.slow
@RELEASE
def test_tasks_that_end_their_process_in_every_way(tmp_path):
    ends_alone(tmp_path / "data_set", ENDING.keys() | HANGING.keys(), 3)


@pytest.mark.slow
@RELEASE
def test_tasks_that_take_all_memory(tmp_path):
    reasons = run(tmp_path / "data_set", GREEDY, 10, memory_limit_bytes=MEMORY_LIMIT_BYTES)
    for name in GREEDY:
        assert f"used more than {MEMORY_LIMIT_BYTES / 1e9:g} GB" in reasons[name]
