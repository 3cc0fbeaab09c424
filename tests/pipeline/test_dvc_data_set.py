"""The stages of this project under DVC itself, over task bodies that cost nothing."""

import os
import sys
from contextlib import chdir
from pathlib import Path

import pytest
import yaml
from repositories import opened
from toys import read_record

from bench.factory import overhead_repository
from bench.factory.overhead_repository import OverheadRepository
from pipeline.audit.contents import Contents
from pipeline.audit.stores import md5_of
from pipeline.audit.verification import verify
from pipeline.audit.versions import read_version
from pipeline.cli import main
from pipeline.dataset.products import read_fingerprint
from pipeline.dataset.stages import MODES, OBJECTS, STAGES, VIEWS
from pipeline.run.run_record import records
from pipeline.store.memo import memo_folder, memo_name

FIRST, SECOND, THIRD = (f"object_{number:05}" for number in range(3))


class Repository(OverheadRepository):
    """Three objects; a mesh that says `poison` fails in the stage views."""

    def __init__(self, root) -> None:
        super().__init__(root, 3)
        (root / "cluster" / "local.yaml").write_text("kwargs: {threads_per_worker: 1}\n")
        stages = yaml.safe_load((root / "dvc.yaml").read_text())
        for name in ("starter", "report"):  # what is not of these objects, and what has tests of its own
            del stages["stages"][name]
        for file in ("data/starter/nothing", "reports/index.html"):
            (root / file).parent.mkdir(exist_ok=True)
            (root / file).touch()
        (root / "dvc.yaml").write_text(yaml.safe_dump(stages, sort_keys=False))
        body = root / "pipeline" / "tasks" / "objects.py"
        text = body.read_text()
        place = "def prepare_object(request):\n"
        assert place in text
        poison = (
            '    if b"poison" in request.inputs["mesh"].read_bytes():\n        raise ValueError("no mesh")\n'
        )
        body.write_text(text.replace(place, place + poison))

    def mesh(self, object_id):
        return self.root / "meshes" / f"{object_id}.obj"

    def repro(self, *arguments: str, code: int = 0) -> str:
        """Run `dvc repro`, a process of its own, which is what a run is; return what it says."""
        done = self.try_("dvc", "repro", *arguments)
        said = done.stdout + done.stderr
        assert (done.returncode != 0) == (code != 0), said
        return said

    def status(self) -> dict[str, object]:
        """What `dvc status` says, but for the stage that it always runs."""
        with opened(self.root) as repository:
            said = repository.status()
        assert said.pop("products") == ["always changed"]
        return said

    def checkout(self, *targets: str) -> None:
        """Do as `dvc checkout` does."""
        with opened(self.root) as repository:
            repository.checkout(list(targets))

    def select(self, only: str) -> None:
        """Restrict what is made."""
        with chdir(self.root):
            assert main(["select", "--only", only]) == 0

    def tasks(self) -> list[str]:
        """Tasks that the last run tried."""
        lines = read_record(records(self.root)[-1])
        return sorted(f"{line['stage']} {line['object']}" for line in lines if line["event"] == "task")

    def recorded(self, path: str) -> int:
        """Number of files of a folder that dvc.lock has."""
        stages = yaml.safe_load((self.root / "dvc.lock").read_text())["stages"].values()
        return next(out["nfiles"] for stage in stages for out in stage.get("outs", []) if out["path"] == path)

    def findings(self):
        """What verification finds in the work tree."""
        stages = tuple(STAGES.values())
        with Contents(self.root) as contents:
            return verify(contents, read_version(contents, stages, None), stages).findings

    def changed(self, before: dict[str, int]) -> set[str]:
        return {path for path, time in self.times().items() if before.get(path) != time}

    def commit(self) -> None:
        self.run("git", "add", "-A")
        self.run("git", "-c", "user.name=t", "-c", "user.email=t@t", "commit", "-qm", "first")

    def times(self) -> dict[str, int]:
        folders = [self.root / kind.folder for stage in STAGES.values() for kind in stage.products]
        files = [path for folder in folders for path in folder.iterdir() if path.name != ".gitignore"]
        return {str(path.relative_to(self.root)): path.stat().st_mtime_ns for path in files}


@pytest.fixture
def repository(tmp_path, monkeypatch) -> Repository:
    monkeypatch.setattr(overhead_repository, "CHUNKS", {})  # nobody looks at images
    monkeypatch.delenv("PYTHONPATH", raising=False)  # stages import the code of their checkout
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE")  # nobody edits that code
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    return Repository(tmp_path / "checkout")


@pytest.mark.slow
def test_life_of_a_data_set(repository):
    # From nothing, `dvc repro` alone makes all of it, each task once and by its first command.
    repository.repro()
    assert repository.tasks() == sorted(
        f"{stage} {name}" for stage in STAGES for name in (FIRST, SECOND, THIRD)
    )
    assert len(records(repository.root)) == 1
    assert repository.status() == {}
    repository.commit()
    whole = repository.times()

    # A rotten bit, size and time unchanged, is named; the product comes from the cache.
    product = VIEWS.path(repository.root, FIRST)
    content, digest = product.read_bytes(), md5_of(product)
    rot(product)
    assert repository.status() == {}  # DVC goes by size and time
    (finding,) = repository.findings()
    assert finding.where == str(product.relative_to(repository.root))
    assert "delete the file, then `dvc checkout data/views`" in finding.remedy
    product.unlink()
    repository.checkout("data/views")
    assert product.read_bytes() == content
    assert repository.findings() == ()

    # Where the cache is rotten, too, it is made again. A failed object is an error of `dvc repro`, and what
    # is finished is recorded. What is not selected stays as it is.
    cached = repository.root / ".dvc" / "cache" / "files" / "md5" / digest[:2] / digest[2:]
    remembered = memo_folder(repository.root, read_fingerprint(product)) / memo_name(product)
    for copy in (product, cached, remembered):
        rot(copy)
    (finding,) = repository.findings()
    assert f"delete the file and {cached}, then" in finding.remedy
    assert "or run `dvc repro`" in finding.remedy
    product.unlink()
    cached.unlink()
    mesh = repository.mesh(SECOND).read_text()
    repository.mesh(SECOND).write_text("# poison\n" + mesh)
    last = STAGES["fidelity"].targets(repository.root, THIRD)[-1]
    last.unlink()
    repository.select(f"{FIRST},{SECOND}")
    said = repository.repro(code=1)
    assert "no mesh" in said
    assert "objects.only selects 2 of 3 objects" in said
    assert repository.tasks() == [f"objects {SECOND}", f"views {FIRST}"]
    assert (product.read_bytes(), md5_of(cached)) == (content, digest)
    assert repository.findings() == ()
    assert repository.recorded("data/views") == 2
    assert set(repository.status()) == {"failures"}
    assert {path for path in repository.changed(whole) if FIRST in path or THIRD in path} == {
        str(product.relative_to(repository.root))
    }
    assert not last.is_file()

    # The next run makes good what failed and what was not selected. An object that the table no longer lists:
    # its products go, and that is said.
    repository.select("")
    repository.mesh(SECOND).write_text(mesh)
    table = repository.root / "data" / "starter.csv"
    table.write_text("".join(line for line in table.open() if FIRST not in line))
    assert f"does not list: {FIRST}" in repository.repro()
    assert last.is_file()
    assert {Path(path).name.partition(".")[0] for path in repository.times()} == {SECOND, THIRD}
    assert repository.status() == {}

    # An older version checked out: one stage runs, and makes nothing.
    repository.run("git", "checkout", "-q", ".")
    repository.checkout()
    before, runs = repository.times(), len(records(repository.root))
    assert before.keys() == whole.keys()
    assert repository.repro().count("Running stage") == 1
    assert repository.changed(before) == set()
    assert not any(map(tasks_of, records(repository.root)[runs:]))
    assert repository.status() == {}

    # One stage asks for what it reads, and makes itself alone.
    missing = [kind.path(repository.root, FIRST) for kind in (OBJECTS, VIEWS, MODES)]
    for path in missing:
        path.unlink()
    with opened(repository.root) as dvc:
        assert [stage.name for stage in dvc.reproduce("views", dry=True)] == ["objects", "views"]
    repository.checkout("data/objects")
    repository.repro("--single-item", "views")
    assert [path.is_file() for path in missing] == [True, True, False]


def rot(path):
    """Flip a bit in the middle of a file, its times kept."""
    known, mode = path.stat(), path.stat().st_mode
    path.chmod(0o644)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    with path.open("r+b") as file:
        file.write(data)
    path.chmod(mode)
    os.utime(path, ns=(known.st_atime_ns, known.st_mtime_ns))


def tasks_of(path):
    return [f"{line['stage']} {line['object']}" for line in read_record(path) if line["event"] == "task"]
