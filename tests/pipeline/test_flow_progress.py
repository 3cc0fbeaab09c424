"""What a person sees of several stages at once, and how long they are told to wait."""

import io
import itertools
import threading
import time

import pytest

from pipeline.run.display import Display
from pipeline.run.flow_progress import LATE, FlowProgress, duration

STAGES = {"objects": (), "views": ("objects",), "modes": ("objects",), "encode": ("views", "modes")}


class Terminal(io.StringIO):
    """A terminal that says when it was written to several times."""

    def __init__(self) -> None:
        super().__init__()
        self.writes = 0
        self.enough = threading.Event()

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        self.writes += 1
        if self.writes >= 3:
            self.enough.set()
        return super().write(text)


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()


def flow(clock, stream):
    progress = FlowProgress(STAGES, stream, clock)
    for index, stage in itertools.product(range(10), STAGES):
        if stage == "objects" and index < 4:
            progress.settle(stage, f"mug_{index}", "kept")
        else:
            progress.expect(stage, f"mug_{index}", 30.0)
    return progress


def test_a_log_has_time_workers_and_shares_now_and_then_and_the_outcomes_at_the_end(clock, monkeypatch):
    monkeypatch.setattr("pipeline.run.display.LOG_INTERVAL_S", 1000.0)
    log = io.StringIO()
    progress = flow(clock, log)
    for _ in range(100):
        progress.workers(2, 2)
    while not log.getvalue():
        time.sleep(0.001)
    clock.now += 30
    for index in (4, 5):
        progress.settle("objects", f"mug_{index}", "computed", 30.0)
    progress.settle("objects", "mug_6", "restored")
    progress.settle("objects", "mug_7", "failed", 1.0)
    progress.close()
    assert log.getvalue().splitlines() == [
        "0%, 9.0 min to go, 2 of 2 workers busy | objects 4/10 | views 0/10 | modes 0/10 | encode 0/10",
        "objects: 2 computed, 1 failed, 4 kept, 1 restored",
        *[f"{stage}: no object" for stage in ("views", "modes", "encode")],
    ]


def test_a_log_goes_on_while_nothing_happens_and_a_short_command_leaves_none(monkeypatch):
    monkeypatch.setattr("pipeline.run.display.LOG_INTERVAL_S", 0.001)
    log = Terminal()
    monkeypatch.setattr(log, "isatty", lambda: False)
    with Display(lambda: "solving modes", stream=log):
        assert log.enough.wait(60)
    quiet = io.StringIO()
    with Display(lambda: "solving modes", stream=quiet, delay_s=60):
        pass
    assert (set(log.getvalue().splitlines()), quiet.getvalue()) == ({"solving modes"}, "")


def test_a_terminal_has_one_bar_that_leaves_only_the_outcomes(clock, monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "70")
    screen = Terminal()
    progress = flow(clock, screen)
    progress.workers(1, 2)
    assert screen.enough.wait(60)
    progress.close()
    shown = screen.getvalue()
    assert "objects 4/10" in shown
    assert "9.0 min to go, 1 of 2 workers busy" in shown
    assert "\033[2K" in shown  # the bar is erased
    assert shown.endswith("encode: no object\n")


def test_nothing_to_do_shows_the_outcomes_alone(clock):
    log = io.StringIO()
    progress = FlowProgress({"views": (), "modes": ()}, log, clock)
    progress.settle("views", "mug", "kept")
    progress.workers(0, 0)
    progress.close()
    assert log.getvalue() == "views: 1 kept\nmodes: no object\n"


def quiet(progress):
    progress._display.start = lambda: None
    return progress


def test_time_to_go_is_work_over_workers_and_no_less_than_a_chain(clock):
    progress = quiet(FlowProgress(STAGES, io.StringIO(), clock))
    assert progress.state()[0] == 0
    for index in range(8):
        progress.expect("views", f"mug_{index}", 100.0)
        progress.expect("encode", f"mug_{index}", 50.0)
    progress.workers(2, 2)
    assert progress.state()[0] == pytest.approx(8 * 150 / 2)
    progress.workers(2, 100)
    assert progress.state()[0] == pytest.approx(150)
    progress.expect("modes", "mug_0", 400.0)
    assert progress.state()[0] == pytest.approx(450)
    clock.now += 60
    assert progress.state()[0] == pytest.approx(450)  # more chains are left than run


def test_time_to_go_follows_what_tasks_needed_and_not_kept_objects(clock):
    progress = FlowProgress({"views": ()}, io.StringIO(), clock)
    for index in range(101):
        progress.expect("views", f"mug_{index}", 10.0)
    progress.settle("views", "mug_0", "kept")
    assert progress.state()[0] == pytest.approx(1000)
    for index in range(1, 51):
        clock.now += 20
        progress.settle("views", f"mug_{index}", "computed", 20.0)
    assert progress.state()[0] == pytest.approx(50 * 20, rel=0.02)


def test_time_to_go_falls_while_a_task_runs_and_never_to_nothing(clock):
    progress = quiet(FlowProgress({"views": ()}, io.StringIO(), clock))
    for name in ("mug", "bell"):
        progress.expect("views", name, 100.0)
    progress.workers(1, 1)
    clock.now += 60
    assert progress.state()[0] == pytest.approx(140)
    clock.now += 60
    progress.settle("views", "mug", "computed", 120.0)
    progress.workers(1, 1)
    assert progress.state()[0] == pytest.approx(120, rel=0.02)
    clock.now += 200
    assert progress.state()[0] == pytest.approx(LATE * 200, rel=0.01)
    assert progress.line().startswith("97%, 50 s to go, 1 of 1 workers busy")


def test_stages_that_have_not_begun_follow_those_that_ended(clock):
    progress = FlowProgress(STAGES, io.StringIO(), clock)
    progress.expect("views", "mug", 50.0)
    progress.expect("encode", "mug", 30.0)
    clock.now += 150
    progress.settle("views", "mug", "computed", 150.0)
    assert progress.state()[0] == pytest.approx(90, rel=0.1)


def test_durations_are_short():
    said = [duration(seconds) for seconds in (-1, 3, 99, 130, 600, 20_000, 1_000_000)]
    assert said == ["0 s", "3 s", "99 s", "2.2 min", "10 min", "5.6 h", "11.6 days"]
