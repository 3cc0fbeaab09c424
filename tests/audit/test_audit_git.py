"""What the audit asks of git: versions in their order, and paths that would be taken for two."""

import os
import subprocess

import pytest
from versions_of_workshop import GIT

from objectfolder.errors import InputError
from pipeline.audit.git import GitRepository


@pytest.fixture
def git(tmp_path):
    """Run git in a new repository; `at` is the time of a commit, seconds since 1970."""

    def run(*arguments, at=0):
        dates = {name: f"{1_000_000_000 + at} +0000" for name in ("GIT_AUTHOR_DATE", "GIT_COMMITTER_DATE")}
        done = subprocess.run(
            ["git", *arguments], cwd=tmp_path, capture_output=True, text=True, check=True,
            env={**os.environ, **GIT, **dates},
        )  # fmt: skip
        return done.stdout.strip()

    run("init", "-q", "-b", "main", "--template=")
    return run


def test_branches_that_were_merged_are_not_mixed(git, tmp_path):
    def version(text, at):
        (tmp_path / "dvc.lock").write_text(text)
        git("add", "dvc.lock")
        git("commit", "-q", "-m", text, at=at)

    version("first", 0)
    git("checkout", "-q", "-b", "other")
    version("other 1", 10)
    version("other 2", 30)
    git("checkout", "-q", "main")
    version("main 1", 20)
    version("main 2", 40)
    git("merge", "-q", "-s", "ours", "--no-commit", "other")
    version("merged", 50)
    found = GitRepository(tmp_path).commits_of("dvc.lock")
    assert [one.subject for one in found] == ["merged", "main 2", "main 1", "first"]


def test_path_with_a_line_break_is_refused(git, tmp_path):
    (tmp_path / "b").write_text("of b")
    (tmp_path / "c").write_text("of c")
    git("add", "b", "c")
    git("commit", "-q", "-m", "two files")
    head = git("rev-parse", "HEAD")
    repository = GitRepository(tmp_path)
    with pytest.raises(InputError, match="line break"):
        repository.read_many([(head, f"a\n{head}:b"), (head, "c")])
    assert repository.read(head, "c") == b"of c"


def test_paths_that_read_like_answers(git, tmp_path):
    for name in ("a blob 3", "a missing"):
        (tmp_path / name).write_text(name)
    git("add", ".")
    git("commit", "-q", "-m", "odd names")
    head = git("rev-parse", "HEAD")
    asked = ["a blob 3", "no blob", "no blob 3", "a missing", "a"]
    found = GitRepository(tmp_path).read_many((head, name) for name in asked)
    assert [found[head, name] for name in asked] == [b"a blob 3", None, None, b"a missing", None]
