"""The clock that waits go by stands still while a process waits for a processor, and only then."""

import subprocess
import sys
from unittest import mock

import pytest

from tests import patience
from tests.patience import OwnClock, wait_until


def test_a_wait_ends() -> None:
    with pytest.raises(TimeoutError, match=r"rain: not within 0\.1 s"):
        wait_until(lambda: False, "rain", 0.1)
    assert wait_until(lambda: "sun") == "sun"


@pytest.mark.parametrize(
    ("ran_s", "waited_s", "own_s"),
    [
        (0.0, 0.0, 10.0),
        (10.0, 0.0, 10.0),
        (0.1, 9.9, 0.1),
        (2.0, 5.0, 5.0),
        (20.0, 20.0, 10.0),
        (1.0, 50.0, 1.0),
    ],
    ids=["asleep", "computing", "kept waiting", "in part", "three threads on two processors", "many wait"],
)
def test_only_waiting_for_a_processor_does_not_count(
    ran_s: float, waited_s: float, own_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    clocks = mock.Mock()
    clocks.monotonic.side_effect = [100.0, 110.0, 110.0, 110.0]
    before, after = {"1": (5.0, 7.0)}, {"2": (ran_s, waited_s), "1": (5.0, 7.0)}
    monkeypatch.setattr(patience, "time", clocks)
    monkeypatch.setattr(patience, "scheduled_s", mock.Mock(side_effect=[before, after, after, after]))
    clock = OwnClock()
    assert clock.read() == pytest.approx(own_s)
    clock.set_back()
    assert clock.read() == 0.0


@pytest.mark.skipif(sys.platform != "linux", reason="the system does not say how long threads waited")
def test_threads_of_children_are_counted() -> None:
    compute = "import time\nwhile time.process_time() < 0.3: pass\nprint(flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-S", "-c", compute], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        ran_s, _ = patience.scheduled_s()[str(child.pid)]
        child.communicate(b"\n")
    assert ran_s == pytest.approx(0.3, abs=0.1)
