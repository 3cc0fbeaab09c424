"""Where the processor's time goes: ``pytest --cpu-seconds 40`` lists the dearest tests and fixtures.

Seconds are those of the process that ran a test and of its children that ended, so that other programs on
the machine do not count. A fixture's seconds are its own: neither those of the fixtures that it asks for,
nor counted to the test that came first.
"""

import os
from collections import Counter
from collections.abc import Generator
from pathlib import PurePosixPath
from typing import Any

import pytest

SHORTEST_S = 0.05  # of a fixture worth a place in a report that a worker sends


def cpu_seconds() -> float:
    """Return seconds of this process and of its children that ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class Meter:
    """Puts the CPU seconds of each phase of a test, and of fixtures made in it, into the phase's report."""

    def __init__(self) -> None:
        self._begin_s = 0.0
        self._nested_s = 0.0  # of fixtures that were made since the one outside of them began
        self._fixtures: Counter[str] = Counter()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self) -> Generator[None, object, object]:
        self._begin_s = cpu_seconds()
        return (yield)

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
    def pytest_runtest_makereport(self) -> Generator[None, Any, Any]:
        report = yield
        now_s = cpu_seconds()
        # xdist sends the attributes of a report along.
        report.cpu_s = now_s - self._begin_s - sum(self._fixtures.values())
        report.fixtures_cpu_s = dict(self._fixtures)
        self._begin_s, self._nested_s = now_s, 0.0
        self._fixtures.clear()
        return report


class Summary:
    """Adds up what the reports of all processes say, and prints it at the end."""

    def __init__(self, count: int) -> None:
        self._count, self._seconds = count, Counter[str]()

    def pytest_runtest_logreport(self, report: Any) -> None:
        # A worker that crashed left a report of pytest-xdist's, which has no seconds.
        self._seconds[report.nodeid] += getattr(report, "cpu_s", 0.0)
        self._seconds.update(getattr(report, "fixtures_cpu_s", {}))

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


def register(config: pytest.Config, count: int) -> None:
    """Measure the tests of this process; its reports, and those that workers send, are summed up."""
    if count:
        config.pluginmanager.register(Meter())
        if not hasattr(config, "workerinput"):
            config.pluginmanager.register(Summary(count))
