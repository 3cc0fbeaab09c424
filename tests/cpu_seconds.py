"""Where the processor's time goes: ``pytest --cpu-seconds 40`` lists the dearest tests and fixtures.

Seconds are those of the process that ran a test and of its children that ended, so that other programs on
the machine do not count. A fixture's seconds are its own: neither those of the fixtures that it asks for,
nor counted to the test that came first.

A test that takes more than `QUICK_S`, with the fixtures that it makes and without compiling kernels, is one
to mark ``slow``. Those without the mark are listed, too; none fails, for processors differ, and a test may be
the first of its process to import something (torch's compiler, with the first optimiser, takes 3 s). Only
seconds of the tests' own process count here, since children may compile, too.
"""

import os
import sys
import time
from collections import Counter
from collections.abc import Generator
from pathlib import PurePosixPath
from typing import Any

import pytest

SHORTEST_S = 0.05  # of a fixture worth a place in a report that a worker sends
QUICK_S = 1.0


def cpu_seconds() -> float:
    """Return seconds of this process and of its children that ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class CompileClock:
    """CPU seconds that this process has spent on compiling kernels, from the first `read` with numba on."""

    def __init__(self) -> None:
        self._seconds, self._begin_s, self._depth = 0.0, 0.0, 0
        self._listens = False

    def read(self) -> float:
        """Return the seconds so far."""
        if not self._listens and "numba" in sys.modules:
            from numba.core import event

            event.Listener.register(CompileClock)
            event.register("numba:compile", self)
            self._listens = True
        return self._seconds

    def notify(self, event: Any) -> None:
        """Take note of where compiling a kernel begins or ends: one may compile others that it calls."""
        self._depth += 1 if event.is_start else -1
        if event.is_start and self._depth == 1:
            self._begin_s = time.thread_time()
        elif self._depth == 0:
            self._seconds += time.thread_time() - self._begin_s


class Meter:
    """Puts the CPU seconds of each phase of a test, and of fixtures made in it, into the phase's report."""

    def __init__(self) -> None:
        self._begin_s = 0.0
        self._compiling = CompileClock()
        self._own_begin_s = 0.0  # of this process, without compiling
        self._nested_s = 0.0  # of fixtures that were made since the one outside of them began
        self._fixtures: Counter[str] = Counter()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self) -> Generator[None, object, object]:
        self._begin_s, self._own_begin_s = cpu_seconds(), self._own_s()
        return (yield)

    def _own_s(self) -> float:
        return time.process_time() - self._compiling.read()

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, object, object]:
        outer_s, self._nested_s, begin_s = self._nested_s, 0.0, cpu_seconds()
        try:
            return (yield)
        finally:
            whole_s = cpu_seconds() - begin_s
            own_s = whole_s - self._nested_s
            self._nested_s = outer_s + whole_s
            if own_s >= SHORTEST_S:
                self._fixtures[f"{fixturedef.baseid or '.'}::{fixturedef.argname} (fixture)"] += own_s

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Generator[None, Any, Any]:
        report = yield
        now_s, own_s = cpu_seconds(), self._own_s()
        # xdist sends the attributes of a report along.
        report.cpu_s = now_s - self._begin_s - sum(self._fixtures.values())
        report.fixtures_cpu_s = dict(self._fixtures)
        report.quick_s = 0.0 if item.get_closest_marker("slow") else own_s - self._own_begin_s
        self._begin_s, self._own_begin_s, self._nested_s = now_s, own_s, 0.0
        self._fixtures.clear()
        return report


class Summary:
    """Adds up what the reports of all processes say, and prints it at the end."""

    def __init__(self, count: int) -> None:
        self._count, self._seconds = count, Counter[str]()
        self._quick = Counter[str]()  # of tests without the mark `slow`, with the fixtures that they make

    def pytest_runtest_logreport(self, report: Any) -> None:
        # A worker that crashed left a report of pytest-xdist's, which has no seconds.
        self._seconds[report.nodeid] += getattr(report, "cpu_s", 0.0)
        self._seconds.update(getattr(report, "fixtures_cpu_s", {}))
        self._quick[report.nodeid] += getattr(report, "quick_s", 0.0)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        terminalreporter.section("CPU seconds")
        folders: Counter[str] = Counter()
        for name, seconds in self._seconds.items():
            folders[str(PurePosixPath(name.partition("::")[0]).parent)] += seconds
        for counts in (Counter(dict(self._seconds.most_common(self._count))), folders):
            for name, seconds in counts.most_common():
                terminalreporter.write_line(f"{seconds:9.1f} {name}")
            terminalreporter.write_line("")
        terminalreporter.write_line(f"{folders.total():9.1f} in all")
        for name, seconds in self._quick.most_common():
            if seconds > QUICK_S:
                terminalreporter.write_line(f"{seconds:9.1f} {name}: not marked slow, to be marked")


def register(config: pytest.Config, count: int) -> None:
    """Measure the tests of this process; its reports, and those that workers send, are summed up."""
    if count:
        config.pluginmanager.register(Meter())
        if not hasattr(config, "workerinput"):
            config.pluginmanager.register(Summary(count))
