"""Failures as people see them."""

from pipeline.dataset.failures import failure_table
from pipeline.dataset.task import Failure


def test_failures_are_a_table_of_object_error_and_remedy():
    table = failure_table(
        [Failure("mug", "mug.obj: no faces", "Export it again."), Failure("x" * 40, "long " * 20)], 80
    ).splitlines()
    assert table[0].split() == ["object", "error", "remedy"]
    assert table[1].split("  ")[0] == "mug"
    assert all(len(line) <= 80 for line in table)
    assert failure_table([]) == ""
