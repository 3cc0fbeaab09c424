"""The toy stages under DVC itself, in a repository of their own."""

import pytest
from repositories import Repository


@pytest.fixture
def repository(toys) -> Repository:
    return Repository(toys)


@pytest.mark.slow
def test_life_of_a_data_set(repository):
    toys = repository.toys
    assert len(repository.repro()) == 9
    repository.commit("first")
    assert "skipping" in repository.run("dvc", "repro").stdout
    assert repository.executed() == []

    # A parameter changed: only what reads it. Set back by hand: nothing, the memo has it.
    toys.set_parameter("training_views", 6)
    assert len(repository.repro()) == 6
    repository.commit("six views")
    toys.set_parameter("training_views", 5)
    assert repository.repro() == []
    assert repository.run("git", "status", "--porcelain").stdout.split() == [
        "M",
        "dvc.lock",
        "M",
        "params.yaml",
    ]
    repository.commit("five again")
    assert repository.run("git", "diff", "--stat", "HEAD~2", "--", "dvc.lock").stdout == ""

    # An old version checked out: nothing runs.
    repository.run("git", "checkout", "-q", "HEAD~1")
    repository.run("dvc", "checkout", "-q")
    assert repository.repro() == []
    repository.run("git", "checkout", "-q", "-")
    repository.run("dvc", "checkout", "-q")

    # One object's material, then one object gone.
    toys.rows["cup"]["material"] = {"stiffness": 5.0}
    repository.save()
    assert repository.repro() == ["encode cup", "tune cup"]
    del toys.rows["dish"]
    repository.save()
    assert repository.repro() == []
    assert not list(toys.root.glob("data/*/dish*"))


@pytest.mark.slow
def test_failure_stops_the_stages_behind_it_and_is_made_good(repository):
    toys = repository.toys
    toys.add("cup", "poison raise ValueError('no cup')")
    failed = repository.run("dvc", "repro", check=False)
    assert failed.returncode != 0
    assert "no cup" in failed.stderr + failed.stdout
    assert len(repository.executed()) == 3
    toys.add("cup", "2.0")
    assert repository.repro() == sorted(
        ["ingest cup", *(f"{task} {name}" for task in ("tune", "encode") for name in ("ball", "cup", "dish"))]
    )


@pytest.mark.slow
def test_fresh_clone_with_one_object_changed_computes_that_object(repository, tmp_path_factory):
    store = tmp_path_factory.mktemp("store")
    repository.run("dvc", "remote", "add", "-q", "-d", "store", str(store))
    repository.make()
    repository.commit("first")
    repository.run("dvc", "push", "-q")
    clone = tmp_path_factory.mktemp("clone") / "clone"
    repository.run("git", "clone", "-q", str(repository.root), str(clone))
    repository.root = clone
    repository.run("dvc", "pull", "-q")
    assert repository.repro() == []
    (clone / "cup.mesh").write_text("7.0")
    assert repository.repro() == ["encode cup", "ingest cup", "tune cup"]
