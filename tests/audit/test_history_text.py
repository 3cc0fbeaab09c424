"""What the history of an object says of versions that cannot be read."""

from objectfolder.errors import FormatError
from pipeline.audit.git import Commit
from pipeline.audit.rendering import history_text


def test_versions_that_differ_by_lists_of_files_alone_are_said_together():
    """Lists are named by their MD5, and versions by hashes that hold as many digits and more."""
    commits = [Commit(digit * 40, 0, "made") for digit in "ab"]
    errors = [FormatError("cache", f"{digit * 32}.dir is not there", "Fetch it") for digit in "cd"]
    errors[1:] = [*errors[1:], FormatError("e" * 40, "no dvc.lock", "Name another")]
    text = history_text("cup", [], list(zip([*commits, commits[0]], errors, strict=True)), 200)
    assert text.count("a list of files is not there") == 1
    assert "e" * 40 in text
