"""Failures as people see them."""

from pipeline.dataset.failures import FailedObject, failure_table


def test_failures_are_a_table_of_object_stage_error_and_remedy():
    mug = FailedObject("mug", "objects", "mug.obj: no faces", "Export it again.")
    table = failure_table([mug, FailedObject("x" * 40, "views", "long " * 20, "")], 80).splitlines()
    assert table[0].split() == ["object", "stage", "error", "remedy"]
    assert table[1].split("  ")[0] == "mug"
    assert all(len(line) <= 80 for line in table)
    assert failure_table([]) == ""
