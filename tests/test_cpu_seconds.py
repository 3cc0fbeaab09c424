"""The list of what the tests cost: fixtures apart from tests, children counted, folders summed."""

import re

import numba
import pytest

from tests import cpu_seconds

pytest_plugins = ["pytester"]

TESTS = """
import subprocess, sys, time
import pytest

def spend(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass

@pytest.fixture(scope="module")
def inner():
    spend(0.1)

@pytest.fixture(scope="module")
def outer(inner):
    spend(0.2)

def test_first(outer):
    pass

def test_second(outer):
    spend(0.3)

@pytest.mark.slow
def test_marked():
    spend(0.3)

def test_of_a_child():
    code = "import time\\nwhile time.process_time() < 0.4: pass"
    subprocess.run([sys.executable, "-S", "-c", code], check=True)
"""


@pytest.mark.slow
def test_seconds_are_those_of_tests_fixtures_and_children(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # their start would take most of the time
    monkeypatch.setattr(cpu_seconds, "QUICK_S", 0.2)
    pytester.makeconftest(
        "from tests import cpu_seconds\ndef pytest_configure(config): cpu_seconds.register(config, 6)"
    )
    pytester.mkdir("room")
    (pytester.path / "room" / "test_spending.py").write_text(TESTS)
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider", "-W", "ignore")
    result.assert_outcomes(passed=4)
    seconds = {
        name: float(number) for number, name in re.findall(r"^ +([\d.]+) (.+)$", result.stdout.str(), re.M)
    }
    names = (
        "test_of_a_child", "test_second", "test_marked", "outer (fixture)", "inner (fixture)", "test_first"
    )  # fmt: skip
    spent = [seconds[f"room/test_spending.py::{name}"] for name in names]
    assert spent == pytest.approx([0.4, 0.3, 0.3, 0.2, 0.1, 0.0], abs=0.1)
    assert seconds["room"] == seconds["in all"] == pytest.approx(sum(spent), abs=0.2)
    # The first test makes both fixtures. Seconds of children say little: they may compile.
    unmarked = re.findall(r"test_spending.py::(\w+): not marked slow, to be marked", result.stdout.str())
    assert sorted(unmarked) == ["test_first", "test_second"]


def test_compiling_a_kernel_counts_apart() -> None:
    clock = cpu_seconds.CompileClock()
    before_s = clock.read()
    kernel = numba.njit(lambda number: number + 1)
    kernel(1)
    compiling_s = clock.read()
    kernel(2)
    assert before_s < compiling_s == clock.read()
