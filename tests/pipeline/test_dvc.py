"""The toy stages under DVC itself, in a repository of their own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

DVC_YAML = {
    "ingest": {"deps": ["rows.json"], "params": ["seed"], "outs": ["data/ingested"]},
    "tune": {
        "deps": ["rows.json", "data/ingested"],
        "params": ["sizes.${size}.vision.training_views"],
        "outs": ["data/tuned"],
    },
    "encode": {"deps": ["data/ingested", "data/tuned"], "outs": ["data/files", "data/quality"]},
}


class Repository:
    def __init__(self, toys) -> None:
        self.toys = toys
        self.root: Path = toys.root
        stages = {}
        for name, stage in DVC_YAML.items():
            outs = [{out: {"persist": True}} for out in stage["outs"]]
            deps = [
                toys.package,
                *stage["deps"],
                *([f"{o}.mesh" for o in toys.rows] if name == "ingest" else []),
            ]
            stages[name] = {**stage, "cmd": f"{sys.executable} driver.py {name}", "deps": deps, "outs": outs}
        (self.root / "dvc.yaml").write_text(yaml.safe_dump({"stages": stages}))
        (self.root / ".gitignore").write_text("/.objectfolder/\n/runs/\n/executed.log\n__pycache__/\n")
        (self.root / "cluster").mkdir()
        (self.root / "cluster" / "local.yaml").write_text("workers: 1\n")
        toys.save()
        self.run("git", "init", "-q")
        self.run("dvc", "init", "-q")
        (self.root / ".dvcignore").write_text("__pycache__\n*.partial\n")

    def run(self, *command: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        if command[0] == "dvc":
            command = (sys.executable, "-m", "dvc", *command[1:])
        environment = {
            **os.environ,
            "DVC_NO_ANALYTICS": "1",
            "GIT_AUTHOR_NAME": "t",
            "GIT_AUTHOR_EMAIL": "t@t",
            "GIT_COMMITTER_NAME": "t",
            "GIT_COMMITTER_EMAIL": "t@t",
        }
        done = subprocess.run(
            command, cwd=self.root, capture_output=True, text=True, check=False, env=environment
        )
        if check and done.returncode:
            raise AssertionError(f"{command}: {done.stdout}{done.stderr}")
        return done

    def repro(self) -> list[str]:
        self.run("dvc", "repro", "-q")
        return self.toys.executed()

    def commit(self, message: str) -> None:
        self.run("git", "add", "-A")
        self.run("git", "commit", "-qm", message)


@pytest.fixture
def repository(toys) -> Repository:
    return Repository(toys)


def test_life_of_a_data_set(repository):
    toys = repository.toys
    assert len(repository.repro()) == 9
    repository.commit("first")
    assert "skipping" in repository.run("dvc", "repro").stdout
    assert toys.executed() == []

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
    toys.save()
    assert repository.repro() == ["encode cup", "tune cup"]
    del toys.rows["dish"]
    toys.save()
    assert repository.repro() == []
    assert not list(toys.root.glob("data/*/dish*"))


def test_failure_stops_the_stages_behind_it_and_is_made_good(repository):
    toys = repository.toys
    toys.add("cup", "poison raise ValueError('no cup')")
    failed = repository.run("dvc", "repro", check=False)
    assert failed.returncode != 0
    assert "no cup" in failed.stderr + failed.stdout
    assert len(toys.executed()) == 3
    toys.add("cup", "2.0")
    assert repository.repro() == sorted(
        ["ingest cup", *(f"{task} {name}" for task in ("tune", "encode") for name in ("ball", "cup", "dish"))]
    )


@pytest.mark.slow
def test_fresh_clone_with_one_object_changed_computes_that_object(repository, tmp_path_factory):
    toys = repository.toys
    store = tmp_path_factory.mktemp("store")
    repository.run("dvc", "remote", "add", "-q", "-d", "store", str(store))
    repository.repro()
    repository.commit("first")
    repository.run("dvc", "push", "-q")
    clone = tmp_path_factory.mktemp("clone") / "clone"
    repository.run("git", "clone", "-q", str(toys.root), str(clone))
    rows = json.loads((clone / "rows.json").read_text())
    for name, row in rows.items():
        row["mesh"] = str(clone / f"{name}.mesh")
    (clone / "rows.json").write_text(json.dumps(rows))
    (clone / "cup.mesh").write_text("7.0")
    repository.root = toys.root = clone
    repository.run("dvc", "pull", "-q")
    assert repository.repro() == ["encode cup", "ingest cup", "tune cup"]
