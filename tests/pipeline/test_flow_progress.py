"""What a person sees of several stages at once, and how long they are told to wait."""

import io
import itertools
import re

import pytest

from pipeline.run.flow_progress import COMPUTED, FAILED, KEPT, RESTORED, FlowProgress, duration
from pipeline.run.forecast.time_to_go import TimeToGo

STAGES = {"objects": (), "views": ("objects",), "modes": ("objects",), "encode": ("views", "modes")}


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()


def flow(clock, stream):
    progress = FlowProgress(STAGES, stream, clock, ticking=False)
    for index in range(10):
        for stage in STAGES:
            if stage == "objects" and index < 4:
                progress.settle(stage, f"mug_{index}", KEPT)
            else:
                progress.expect(stage, f"mug_{index}", 30.0)
    return progress


def test_a_line_names_counts_of_current_stages_workers_rate_and_time(clock):
    log = io.StringIO()
    progress = flow(clock, log)
    progress.workers(2, 2)
    assert log.getvalue() == (
        "9 min to go, 2 of 2 workers busy | objects: 4 kept, 6 left | views: 10 left | modes: 10 left"
        " | encode: 10 left\n"
    )
    clock.now += 30
    for index in (4, 5):
        progress.settle("objects", f"mug_{index}", COMPUTED, 30.0)
    progress.settle("objects", "mug_6", RESTORED)
    progress.settle("objects", "mug_7", FAILED, 1.0)
    progress.workers(1, 2)
    line = log.getvalue().splitlines()[-1]
    assert "objects: 2 done, 5 kept, 1 failed, 2 left" in line
    assert "4 tasks/min" in line
    assert "1 of 2 workers busy" in line
    for stage in STAGES:
        for index in range(10):
            progress.settle(stage, f"mug_{index}", COMPUTED, 30.0)
    assert "left" not in progress.line()


def test_a_finished_stage_leaves_the_line(clock):
    progress = flow(clock, io.StringIO())
    for index in range(4, 10):
        progress.settle("objects", f"mug_{index}", COMPUTED, 30.0)
    assert "objects" not in progress.line()
    assert "views: 10 left" in progress.line()


def test_a_terminal_sees_one_line_within_its_width(clock, monkeypatch):
    for columns in (40, 80, 200):
        monkeypatch.setenv("COLUMNS", str(columns))
        screen = Terminal()
        progress = flow(clock, screen)
        for index in range(9, -1, -1):
            clock.now += 1
            progress.settle("views", f"mug_{index}", COMPUTED, 30.0)
            progress.workers(2, 2)
        assert "\n" not in screen.getvalue()
        shown = [line.removesuffix("\033[K") for line in screen.getvalue().split("\r")[1:]]
        assert len(shown) == 10
        assert all(len(line) < columns for line in shown)
        assert all(line.startswith(("9 min", "8 min", "7 min", "6 min", "5 min")) for line in shown)
        assert ("views 9/10" in shown[8]) is (columns == 80)
        assert ("views: 9 done, 1 left" in shown[8]) is (columns == 200)
        progress.close()
        assert screen.getvalue().endswith("encode: 0 done, 0 kept, 0 failed in 10 s\033[K\n\033[K")
        assert screen.getvalue().count("\n") == len(STAGES)


def test_a_terminal_is_not_written_to_more_often_than_one_can_see(clock):
    screen = Terminal()
    progress = flow(clock, screen)
    for _ in range(1000):
        clock.now += 0.01
        progress.workers(2, 2)
    assert 30 <= screen.getvalue().count("\r") <= 51


def test_a_log_gets_a_line_every_quarter_of_a_minute_and_later_every_minute(clock):
    log = io.StringIO()
    progress = flow(clock, log)
    times = []
    for _ in range(7200):
        before = log.getvalue().count("\n")
        progress.workers(1, 2)
        if log.getvalue().count("\n") > before:
            times.append(clock.now - 100)
        clock.now += 1
    gaps = [late - early for early, late in itertools.pairwise(times)]
    assert times[0] == 0
    assert gaps[0] == 15
    assert gaps == sorted(gaps)
    assert gaps[-1] == 60


def test_nothing_to_do_is_a_line_a_stage(clock):
    log = io.StringIO()
    progress = FlowProgress({"views": (), "modes": ()}, log, clock)
    progress.settle("views", "mug", KEPT)
    progress.workers(0, 0)
    progress.close()
    progress.close()
    assert log.getvalue() == "views: 0 done, 1 kept, 0 failed\nmodes: 0 done, 0 kept, 0 failed\n"


def test_the_line_goes_on_while_nothing_happens(monkeypatch):
    import threading

    monkeypatch.setattr("pipeline.run.flow_progress.TICK_S", 0.01)
    monkeypatch.setattr("pipeline.run.flow_progress.REDRAW_S", 0.0)
    enough = threading.Event()

    class Counting(Terminal):
        def write(self, text: str) -> int:
            if self.getvalue().count("\r") >= 3:
                enough.set()
            return super().write(text)

    screen = Counting()
    progress = FlowProgress({"views": ()}, screen)
    progress.expect("views", "mug", 1000.0)
    progress.workers(1, 1)
    assert enough.wait(60)
    progress.close()
    size = len(screen.getvalue())
    assert not [thread for thread in threading.enumerate() if thread is progress._ticker]
    assert len(screen.getvalue()) == size


def test_time_to_go_is_work_over_workers_and_no_less_than_the_longest_chain(clock):
    to_go = TimeToGo(STAGES, clock)
    assert to_go.seconds() is None
    for index in range(8):
        to_go.expect("views", f"mug_{index}", 100.0)
        to_go.expect("encode", f"mug_{index}", 50.0)
    to_go.workers(2, 2)
    assert to_go.seconds() == pytest.approx(8 * 150 / 2)
    to_go.workers(2, 100)
    assert to_go.seconds() == pytest.approx(150)
    to_go.expect("modes", "mug_0", 400.0)
    assert to_go.seconds() == pytest.approx(450)
    clock.now += 60
    assert to_go.seconds() == pytest.approx(390)


def test_time_to_go_follows_what_tasks_really_take(clock):
    to_go = TimeToGo({"views": ()}, clock)
    for index in range(101):
        to_go.expect("views", f"mug_{index}", 10.0)
    to_go.workers(1, 1)
    for index in range(50):
        clock.now += 20
        to_go.settle("views", f"mug_{index}", 20.0)
    assert to_go.seconds() == pytest.approx(51 * 20, rel=0.03)
    clock.now += 10  # half of the next one is done
    assert to_go.seconds() == pytest.approx(50.5 * 20, rel=0.03)


def test_time_to_go_of_a_simulated_flow_is_right_throughout(clock):
    """Eight tasks of a stage on two workers, each twice as long as expected: told at every end."""
    to_go = TimeToGo({"views": ()}, clock)
    for index in range(40):
        to_go.expect("views", f"mug_{index}", 5.0 + index % 3)
    true = {f"mug_{index}": 2 * (5.0 + index % 3) for index in range(40)}
    free_at, ends = [clock.now, clock.now], []
    for name, seconds in true.items():
        worker = free_at.index(min(free_at))
        free_at[worker] += seconds
        ends.append((free_at[worker], name, seconds))
    end = max(free_at)
    to_go.workers(2, 2)
    for at, name, seconds in sorted(ends)[:-4]:
        clock.now = at
        to_go.settle("views", name, seconds)
        if at > 150:
            assert to_go.seconds() == pytest.approx(end - at, rel=0.2, abs=6)


def test_kept_objects_say_nothing_of_the_pace(clock):
    to_go = TimeToGo({"views": ()}, clock)
    for index in range(10):
        to_go.expect("views", f"mug_{index}", 10.0)
    to_go.settle("views", "mug_0", 0.0)
    assert to_go.left() == 9
    assert to_go.seconds() == pytest.approx(90)


def test_the_width_is_never_exceeded(clock):
    progress = flow(clock, io.StringIO())
    whole = progress.line()
    for width in range(1, 200):
        line = progress.line(width)
        assert len(line) <= width
        assert line == whole or line.endswith("…") or re.search(r"encode \d+/10$", line)


def test_durations_are_those_of_a_person():
    said = [duration(seconds) for seconds in (3, 99, 600, 20_000, 1_000_000)]
    assert said == ["3 s", "99 s", "10 min", "5.6 h", "11.6 days"]
