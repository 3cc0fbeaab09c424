"""Forks that wait for the queries of other threads.

A forked child has one thread, and every lock as it was. What another thread had locked stays locked in the
child for good: a cached property (Python 3.11), numba's compiler, or OpenBLAS, whose own handler of forks can
stop the parent, too. So a fork waits until no other thread is in a query, and queries that begin meanwhile
wait for the fork.
"""

import concurrent.futures.thread
import functools
import logging
import os
import threading
import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
FORK_LOOK_S = 0.001
# They lock at a fork what a query may need: registered before this module, they are called after it.
LOCKED_LATER = (concurrent.futures.thread, logging)


class ForkGate:
    """Who is in a query, and who forks.

    A query marks itself and then looks for a fork; a fork marks itself and then looks for queries. Of two at
    once, one sees the other. Operations on a dictionary are atomic, so a query takes no lock.
    """

    def __init__(self) -> None:
        self.inside: dict[int, None] = {}  # threads
        self._one_fork = threading.Lock()
        self._forking: int | None = None  # a thread

    def enter(self, thread: int) -> None:
        """Mark a thread as in a query, once no fork is under way."""
        self.inside[thread] = None
        while self._forking is not None:
            del self.inside[thread]
            with self._one_fork:
                self.inside[thread] = None

    def close(self) -> None:
        """Wait for the queries of other threads; a thread that forks from within a query does not wait."""
        thread = threading.get_ident()
        if thread in self.inside:
            return
        self._one_fork.acquire()
        self._forking = thread
        while self.inside:
            time.sleep(FORK_LOOK_S)

    def open(self) -> None:
        """Let queries go on, in the parent."""
        if self._forking == threading.get_ident():
            self._forking = None
            self._one_fork.release()

    def begin_anew(self) -> None:
        """Forget the threads that the child has not."""
        thread = threading.get_ident()
        self.inside = {thread: None} if thread in self.inside else {}
        self._one_fork, self._forking = threading.Lock(), None


GATE = ForkGate()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=GATE.close, after_in_parent=GATE.open, after_in_child=GATE.begin_anew)


def hold_forks(query: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Let `os.fork` in other threads wait while a function runs; for none that waits for another thread.

    Examples
    --------
    >>> from objectfolder.forks import GATE, hold_forks
    >>> @hold_forks
    ... def query():
    ...     return len(GATE.inside)
    >>> query(), len(GATE.inside)
    (1, 0)
    """

    @functools.wraps(query)
    def call(*arguments: Parameters.args, **keywords: Parameters.kwargs) -> Result:
        thread = threading.get_ident()
        if thread in GATE.inside:  # a query of this one's
            return query(*arguments, **keywords)
        try:
            GATE.enter(thread)
            return query(*arguments, **keywords)
        finally:
            GATE.inside.pop(thread, None)

    return call
