"""What a person sees of a stage."""

import io

from pipeline.progress import Progress, duration, failure_table
from pipeline.task import Failure, Outcome


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_sees_one_line_that_changes():
    screen = Terminal()
    progress = Progress("views", 3, 0, {"a": 10.0, "b": 5.0}, screen)
    progress.add(Outcome("a"))
    progress.add(Outcome("b", Failure("b", "no")))
    progress.close()
    assert screen.getvalue().count("\n") == 1
    lines = [line.removeprefix("\033[K") for line in screen.getvalue().split("\r")]
    assert lines[1] == "views: 0 done, 3 kept, 0 failed, 2 left"
    assert lines[2].startswith("views: 1 done, 3 kept, 0 failed, 1 left, ")
    assert lines[2].endswith(" to go")
    assert lines[-1].startswith("views: 1 done, 3 kept, 1 failed in ")


def test_a_log_gets_a_line_at_the_start_and_at_the_end():
    log = io.StringIO()
    progress = Progress("views", 0, 0, {str(index): 1.0 for index in range(50)}, log)
    for index in range(50):
        progress.add(Outcome(str(index)))
    progress.close()
    assert log.getvalue().splitlines() == [
        "views: 0 done, 0 kept, 0 failed, 50 left",
        "views: 50 done, 0 kept, 0 failed in 0 s",
    ]


def test_nothing_to_do_is_one_line():
    log = io.StringIO()
    Progress("views", 7, 0, {}, log).close()
    assert log.getvalue() == "views: 0 done, 7 kept, 0 failed\n"


def test_durations_are_those_of_a_person():
    assert [duration(seconds) for seconds in (3, 99, 600, 20000)] == ["3 s", "99 s", "10 min", "5.6 h"]


def test_failures_are_a_table_of_object_error_and_remedy():
    table = failure_table(
        [Failure("mug", "mug.obj: no faces", "Export it again."), Failure("x" * 40, "long " * 20)], 80
    ).splitlines()
    assert table[0].split() == ["object", "error", "remedy"]
    assert table[1].split("  ")[0] == "mug"
    assert all(len(line) <= 80 for line in table)
    assert failure_table([]) == ""
