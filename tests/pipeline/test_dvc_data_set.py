"""The stages of this project under DVC itself, in the situations of a data set's life; tasks cost nothing."""

import copy
import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import chdir
from pathlib import Path

import psutil
import pytest
import yaml
from chaos import is_gone
from patience import wait_until
from repositories import opened
from toys import read_record

from bench.factory import overhead_repository
from bench.factory.overhead_repository import OverheadRepository
from objectfolder.products.store import Array, Product, read_product, write_product
from pipeline.cli import main
from pipeline.cli.reproduce import reproduce
from pipeline.dataset.products import md5_of
from pipeline.dataset.stages import COLLISION, STAGES, TOUCHES, VIEWS
from pipeline.run.exclusive import owner
from pipeline.run.run_record import records

FIRST, SECOND, THIRD = (f"object_{number:05}" for number in range(3))
POISON = """
    text = request.inputs["mesh"].read_bytes()
    if b"poison" in text:
        raise ValueError("no mesh")
    if b"slow" in text:
        import time
        time.sleep(60)
"""


class Repository(OverheadRepository):
    """Three objects; a mesh that says `poison` fails, one that says `slow` takes a minute."""

    def __init__(self, root: Path) -> None:
        super().__init__(root, 3)
        (root / "cluster" / "local.yaml").write_text("kwargs: {threads_per_worker: 1}\n")
        stages = yaml.safe_load((root / "dvc.yaml").read_text())
        for name in ("starter", "report"):  # what is not of these objects, and what has tests of its own
            del stages["stages"][name]
        stages["stages"]["failures"]["deps"].remove("reports/index.html")
        # The order of the file means nothing.
        stages["stages"] = dict(reversed(stages["stages"].items()))
        (root / "dvc.yaml").write_text(yaml.safe_dump(stages, sort_keys=False))
        self.edit("pipeline/tasks/objects.py", "def prepare_object(request):\n", POISON)

    def edit(self, name: str, place: str, text: str) -> None:
        """Put a text behind a place in a file."""
        path = self.root / name
        content = path.read_text()
        assert place in content
        path.write_text(content.replace(place, place + text, 1))

    def mesh(self, object_id: str) -> Path:
        """The mesh of an object."""
        return self.root / "meshes" / f"{object_id}.obj"

    def repro(self, *targets: str, code: int = 0) -> list[str]:
        """Run `dvc repro`; return the tasks that were tried."""
        before = set(records(self.root))
        with chdir(self.root):
            assert reproduce(targets) == code
        new = [path for path in records(self.root) if path not in before]
        lines = [line for path in new for line in read_record(path)]
        return sorted(f"{line['stage']} {line['object']}" for line in lines if line["event"] == "task")

    def status(self) -> list[str]:
        """The stages that `dvc status` calls changed."""
        with opened(self.root) as repository:
            return sorted(repository.status())

    def checkout(self) -> None:
        """Do as `dvc checkout` does."""
        with opened(self.root) as repository:
            repository.checkout()

    def commit(self, message: str) -> None:
        """Commit everything, and tag it."""
        self.run("git", "add", "-A")
        self.run("git", "-c", "user.name=t", "-c", "user.email=t@t", "commit", "-qm", message)
        self.run("git", "tag", message)

    def products(self) -> dict[str, str]:
        """MD5 of all products by path."""
        kinds = [kind for stage in STAGES.values() for kind in stage.products]
        paths = [
            kind.path(self.root, object_id) for kind in kinds for object_id in kind.object_ids(self.root)
        ]
        return {str(path.relative_to(self.root)): md5_of(path) for path in paths}


def tasks(stages: Sequence[str], *object_ids: str) -> list[str]:
    return sorted(f"{stage} {object_id}" for stage in stages for object_id in object_ids)


@pytest.fixture
def repository(tmp_path, monkeypatch) -> Repository:
    monkeypatch.setattr(overhead_repository, "CHUNKS", {})  # nobody looks at images
    for name in ("PYTHONPATH", "PYTHONSAFEPATH"):  # stages import the code of their checkout
        monkeypatch.delenv(name, raising=False)
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)  # nobody edits that code
    monkeypatch.setenv("SHELL", "/bin/sh")  # DVC's choice where none is set, and dash on Debian
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    return Repository(tmp_path / "checkout")


@pytest.mark.slow
def test_life_of_a_data_set(repository, tmp_path, capfd):
    root = repository.root
    # From nothing, `dvc repro` alone makes all of it, each task once and in one run.
    assert repository.repro() == tasks(STAGES, FIRST, SECOND, THIRD)
    assert len(records(root)) == 1
    assert repository.status() == []
    repository.commit("v1")
    first = repository.products()

    # A comment in one task and a constant in another: what follows from the constant, and nothing else.
    repository.edit("pipeline/tasks/views.py", "\n", "# a comment\n")
    touches = "pipeline/tasks/touches.py"
    repository.edit(touches, "def product(chunks, attributes):\n", '    attributes["constant"] = 1\n')
    assert repository.status() == ["code"]
    changed = ("data/touches", "data/fidelity", "data/object_files")  # Object Files carry their fidelity
    rest = {path: md5 for path, md5 in first.items() if not path.startswith(changed)}
    assert repository.repro() == tasks(["touches", "fidelity"], FIRST, SECOND, THIRD)
    assert repository.status() == []
    assert rest.items() <= repository.products().items()

    # An object that fails is tried by every run until it is cured. What is finished is recorded.
    mesh = repository.mesh(SECOND).read_text()
    repository.mesh(SECOND).write_text("# poison\n" + mesh)
    assert repository.status() == ["inputs"]
    for _ in range(2):
        assert repository.repro(code=1) == [f"objects {SECOND}"]
        assert repository.status() == ["failures", "products"]
    assert "no mesh" in capfd.readouterr().err
    assert not VIEWS.path(root, SECOND).exists()
    repository.mesh(SECOND).write_text(mesh + "v 0 0 2\n")
    assert repository.repro() == tasks(STAGES, SECOND)
    assert repository.status() == []

    # Changed in place into another whole product, damaged, and deleted: named, and as before.
    before = repository.products()
    launder(TOUCHES.path(root, FIRST))
    COLLISION.path(root, FIRST).write_bytes(b"damaged")
    VIEWS.path(root, THIRD).unlink()
    assert repository.status() == ["collision", "touches", "views"]
    assert repository.repro() == []  # DVC's cache has them
    said = capfd.readouterr().err
    assert f"data/touches/{FIRST}.zarr.zip: changed since it was made" in said
    assert f"data/collision/{FIRST}.zarr.zip: changed since it was made" in said
    assert repository.products() == before
    assert repository.status() == []

    # A parameter, objects left out, and a row less.
    parameters = root / "params.yaml"
    text = parameters.read_text()
    parameters.write_text(text.replace("most_parts: ", "most_parts: 1", 1))
    with chdir(root):
        assert main(["select", "--only", FIRST]) == 0
    assert "selection" not in repository.run("git", "status", "--porcelain", "-uall").stdout
    assert repository.repro() == [f"collision {FIRST}", f"fidelity {FIRST}"]
    assert repository.products().keys() == before.keys()
    with chdir(root):
        assert main(["select", "--only", ""]) == 0
    assert repository.status() == ["products"]
    table = root / "data" / "starter.csv"
    table.write_text("".join(line for line in table.open() if THIRD not in line))
    assert repository.repro() == [f"collision {SECOND}", f"fidelity {SECOND}"]
    assert f"does not list: {THIRD}" in capfd.readouterr().out
    assert {Path(path).name.partition(".")[0] for path in repository.products()} == {FIRST, SECOND}
    assert repository.status() == []
    remote = f"[core]\n    remote = store\n['remote \"store\"']\n    url = {tmp_path / 'store'}\n"
    (root / ".dvc" / "config").write_text(remote)
    repository.commit("v2")

    # An older version, checked out; back; what no commit needs goes from the cache.
    second = repository.products()
    repository.run("git", "checkout", "-q", "v1")
    repository.checkout()
    assert repository.products() == first
    assert repository.status() == []
    repository.run("git", "checkout", "-q", "v2")
    repository.checkout()
    with opened(root) as dvc:
        dvc.gc(workspace=True)
    assert repository.products() == second
    assert repository.status() == []

    # In a clone, `dvc pull` brings all, by hard links where it is told to. A product damaged in place is then
    # damaged in DVC's cache, too, and made again.
    with opened(root) as dvc:
        dvc.push()
    repository.run("git", "clone", "-q", str(root), str(tmp_path / "clone"))
    clone = copy.copy(repository)
    clone.root = tmp_path / "clone"
    (clone.root / ".dvc" / "config.local").write_text("[cache]\n    type = hardlink\n")
    with opened(clone.root) as dvc:
        dvc.pull()
    assert clone.status() == []
    assert clone.repro() == []
    assert clone.products() == second
    assert files_of(clone) == files_of(clone, ".dvc/cache/files/md5")
    damaged = COLLISION.path(clone.root, FIRST)
    damaged.chmod(0o644)
    damaged.write_bytes(b"damaged")
    damaged.chmod(0o444)
    assert clone.repro() == [f"collision {FIRST}"]
    assert clone.products() == second
    assert clone.status() == []
    assert files_of(clone) == files_of(clone, ".dvc/cache/files/md5")

    # DVC killed alone: no process of its run stays, and the next run does what is left.
    mesh = repository.mesh(FIRST).read_text()
    repository.mesh(FIRST).write_text("# slow\n" + mesh)
    with subprocess.Popen([sys.executable, "-m", "dvc", "repro", "-q"], cwd=root) as dvc:
        wait_until(lambda: owner(root), "a run")
        wait_until(lambda: any((root / "runs").glob("*")) and len(below(dvc.pid)) > 2, "a task")
        processes = below(dvc.pid)
        dvc.kill()
    wait_until(lambda: all(map(is_gone, processes)), "the end of all processes")
    repository.mesh(FIRST).write_text(mesh)
    assert repository.repro() == []
    assert repository.products() == second
    assert repository.status() == []


def files_of(repository: Repository, folder: str = "") -> set[int]:
    """Inodes of all products, or of those of their bytes that lie in a folder."""
    paths = [repository.root / path for path in repository.products()]
    if folder:
        digests = map(md5_of, paths)
        paths = [repository.root / folder / md5[:2] / md5[2:] for md5 in digests]
    return {path.stat().st_ino for path in paths}


def below(pid: int) -> list[psutil.Process]:
    return psutil.Process(pid).children(recursive=True)


def launder(path: Path) -> None:
    """Write another whole product with the same attributes in place of one."""
    product = read_product(path)
    values = product.arrays["values"]
    changed = Array(values.data + 0.25, values.dims, values.units, values.long_name)
    write_product(path, Product({**product.arrays, "values": changed}, product.attributes))
