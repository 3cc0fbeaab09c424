"""What the audit asks of git: versions in their order, and files by any path."""

import os
import subprocess

import pytest
from versions_of_workshop import GIT

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
    commits = GitRepository(tmp_path).commits_of(["dvc.lock"])
    assert [commit.subject for commit in commits] == ["merged", "main 2", "main 1", "first"]


def test_paths_that_read_like_answers_of_git(git, tmp_path):
    names = ("a blob 3", "a missing", "a\nHEAD:b")
    for name in names:
        (tmp_path / name).write_text(name)
    git("add", ".")
    git("commit", "-q", "-m", "odd names")
    head = git("rev-parse", "HEAD")
    repository = GitRepository(tmp_path)
    for name in names:
        assert repository.read(head, name) == name.encode()
    assert repository.read(head, "no blob") is None
