"""The toy stages in a git repository under DVC."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from pathlib import Path

import yaml
from dvc.repo import Repo
from toys import Toys

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
    """A checkout; experiments and clones of it count their executions where it does.

    Parameters
    ----------
    toys
        The toys; they become the checkout.
    """

    def __init__(self, toys: Toys) -> None:
        self.toys = toys
        self.root: Path = toys.root
        self.log = toys.root / "executed.log"
        place = 'Path(__file__).parents[1] / "executed.log"'
        assert place in toys.tasks.read_text()
        toys.tasks.write_text(toys.tasks.read_text().replace(place, repr(str(self.log))))
        stages = {}
        for name, stage in DVC_YAML.items():
            outs = [{out: {"persist": True}} for out in stage["outs"]]
            meshes = [f"{object_id}.mesh" for object_id in toys.rows] if name == "ingest" else []
            deps = [toys.package, *stage["deps"], *meshes]
            command = f"{sys.executable} driver.py {name}"
            stages[name] = {**stage, "cmd": command, "deps": deps, "outs": outs}
        (self.root / "dvc.yaml").write_text(yaml.safe_dump({"stages": stages}))
        (self.root / ".gitignore").write_text("/.objectfolder/\n/runs/\n/executed.log\n__pycache__/\n")
        (self.root / "cluster").mkdir()
        (self.root / "cluster" / "local.yaml").write_text("kwargs: {threads_per_worker: 1}\n")
        self.save()
        self.run("git", "init", "-q")
        self.run("dvc", "init", "-q")
        (self.root / ".dvcignore").write_text("__pycache__\n*.partial\n")

    def save(self) -> None:
        """Write what a driver process needs, meshes as they are called in any copy of the checkout."""
        self.toys.save()
        rows = json.loads((self.root / "rows.json").read_text())
        for row in rows.values():
            row["mesh"] = Path(row["mesh"]).name
        (self.root / "rows.json").write_text(json.dumps(rows))
        driver = (self.root / "driver.py").read_text()
        assert 'Path(row["mesh"])' in driver
        (self.root / "driver.py").write_text(driver.replace('Path(row["mesh"])', 'root / row["mesh"]'))

    def run(self, *command: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Run a command in the checkout."""
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

    def executed(self) -> list[str]:
        """Return the executions since the last time this was asked, sorted."""
        lines = self.log.read_text().splitlines() if self.log.exists() else []
        self.log.unlink(missing_ok=True)
        return sorted(lines)

    def make(self) -> list[str]:
        """Make all products at once, let DVC see them, and return what was executed."""
        self.run(sys.executable, "driver.py", ",".join(DVC_YAML))
        return self.repro()

    def repro(self) -> list[str]:
        """Run ``dvc repro`` and return what was executed."""
        self.run("dvc", "repro", "-q")
        return self.executed()

    def commit(self, message: str) -> None:
        """Commit everything."""
        self.run("git", "add", "-A")
        self.run("git", "commit", "-qm", message)


@contextmanager
def opened(root: Path) -> Iterator[Repo]:
    """DVC's repository in a folder."""
    with chdir(root), Repo() as repository:
        yield repository
