import os
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import objectfolder
from objectfolder.forks import GATE, hold_forks
from tests.patience import PATIENCE_S, wait_until

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")


def end_of_child(run: Callable[[], bool]) -> int:
    """Fork, and return the status: 0 where `run` returned True in the child, -9 where it does not end."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of threads
        child = os.fork()
    if not child:
        try:
            os._exit(0 if run() else 1)
        finally:
            os._exit(2)
    status: list[int] = []

    def ended() -> bool:
        pid, code = os.waitpid(child, os.WNOHANG)
        status.append(os.waitstatus_to_exitcode(code))
        return pid != 0

    try:
        wait_until(ended, "the child's end")
    except TimeoutError:
        os.kill(child, 9)
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return status[-1]


@contextmanager
def busy(work: Callable[[], object]) -> Iterator[None]:
    """Do something again and again in another thread meanwhile."""
    stop = threading.Event()

    def go_on() -> None:
        while not stop.is_set():
            work()

    thread = threading.Thread(target=go_on)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def test_no_lock_of_a_query_is_locked_in_a_forked_child():
    lock = threading.Lock()

    @hold_forks
    def query() -> bool:
        with lock:
            time.sleep(0.01)
        return True

    @hold_forks
    def outer() -> bool:  # one query asks another
        return query()

    with busy(outer):
        assert [end_of_child(outer) for _ in range(5)] == [0] * 5
    assert not GATE.inside


def test_queries_that_begin_before_a_fork_wait_for_it():
    began, end = threading.Event(), threading.Event()

    @hold_forks
    def long() -> bool:
        began.set()
        return end.wait(PATIENCE_S)

    @hold_forks
    def short() -> bool:
        return True

    with ThreadPoolExecutor(3) as pool:
        first = pool.submit(long)
        assert began.wait(PATIENCE_S)
        fork = pool.submit(end_of_child, short)
        wait_until(lambda: GATE._forking is not None, "a fork that waits")
        second: Future[bool] = pool.submit(short)
        time.sleep(0.05)
        assert not fork.done()
        assert not second.done()
        end.set()
        assert first.result(PATIENCE_S)
        assert fork.result() == 0
        assert second.result(PATIENCE_S)


def test_a_fork_from_within_a_query_does_not_wait_for_itself():
    @hold_forks
    def query() -> int:
        return end_of_child(lambda: len(GATE.inside) == 1)

    assert query() == 0
    assert end_of_child(lambda: not GATE.inside) == 0


def test_a_child_answers_beside_a_thread_that_queries(small_file: Path):
    bar = objectfolder.load(small_file)
    points, normals = bar.sample_contacts(1, seed=0)
    sound, touch = bar.strike(points, -normals, 0.02), bar.press(points).rgb

    def ask() -> bool:
        same = np.array_equal(bar.strike(points, -normals, 0.02), sound)
        return same and np.array_equal(bar.press(points).rgb, touch)

    with busy(ask):
        assert [end_of_child(ask) for _ in range(3)] == [0] * 3
