"""The stages of this project under DVC itself, over task bodies that cost nothing."""

import json
import os
import subprocess

import pytest
import yaml
from toys import read_record

from bench.factory.overhead_repository import OverheadRepository
from pipeline.audit.contents import Contents
from pipeline.audit.stores import md5_of
from pipeline.audit.verification import verify
from pipeline.audit.versions import read_version
from pipeline.dataset.products import read_fingerprint
from pipeline.dataset.stages import STAGES, VIEWS
from pipeline.run.run_record import records
from pipeline.store.memo import memo_folder, memo_name

FIRST, SECOND, THIRD = (f"object_{number:05}" for number in range(3))


class Repository(OverheadRepository):
    """Three objects; a mesh that says `poison` fails in the stage views."""

    def __init__(self, root) -> None:
        super().__init__(root, 3)
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

    def repro(self, code: int = 0, *arguments: str) -> subprocess.CompletedProcess[str]:
        done = self.try_("dvc", "repro", *arguments)
        assert (done.returncode != 0) == (code != 0), done.stdout + done.stderr
        return done

    def status(self) -> dict[str, object]:
        """What `dvc status` says, but for the stage that it always runs."""
        said = json.loads(self.run("dvc", "status", "--json").stdout)
        assert said.pop("products") == ["always changed"]
        return said

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

    def times(self) -> dict[str, int]:
        folders = [self.root / kind.folder for stage in STAGES.values() for kind in stage.products]
        files = [path for folder in folders for path in folder.iterdir() if path.name != ".gitignore"]
        return {str(path.relative_to(self.root)): path.stat().st_mtime_ns for path in files}


@pytest.fixture(scope="module")
def repository(tmp_path_factory):
    return Repository(tmp_path_factory.mktemp("data_set") / "checkout")


@pytest.mark.slow
def test_life_of_a_data_set(tmp_path):
    repository = Repository(tmp_path / "checkout")
    # From nothing, `dvc repro` alone makes all of it, each task once and by its first command.
    repository.repro()
    assert repository.tasks() == sorted(
        f"{stage} {name}" for stage in STAGES for name in (FIRST, SECOND, THIRD)
    )
    assert len(records(repository.root)) == 1
    assert repository.status() == {}
    before = repository.times()
    done = repository.repro()
    assert done.stdout.count("Running stage") == 1
    assert repository.changed(before) == set()
    repository.run("git", "add", "-A")

    # A failed object is an error of `dvc repro`; what is finished is recorded; the next one tries it again.
    whole = repository.mesh(SECOND).read_text()
    repository.mesh(SECOND).write_text("# poison\n" + whole)
    repository.write_mesh(THIRD, 0.7)
    done = repository.repro(1)
    assert "no mesh" in done.stdout
    assert repository.recorded("data/views") == 2
    assert set(repository.status()) == {"failures"}
    assert repository.repro(1).stdout.count("Running stage") == 2
    assert repository.tasks() == [f"objects {SECOND}"]
    repository.mesh(SECOND).write_text(whole)
    repository.repro()
    assert repository.status() == {}
    assert repository.recorded("data/views") == 3

    # A selection restricts what is made; other products stay as they are, and nothing of it is remembered.
    before = repository.times()
    repository.run("python", "-m", "pipeline.cli", "select", "--only", FIRST)
    for name in (FIRST, SECOND):
        repository.write_mesh(name, 0.8)
    assert "objects.only selects 1 of 3 objects" in repository.repro().stdout
    assert repository.changed(before) == {path for path in before if FIRST in path}
    repository.run("python", "-m", "pipeline.cli", "select", "--only", "")
    repository.repro()
    assert repository.changed(before) == {path for path in before if FIRST in path or SECOND in path}

    # An object that the table no longer lists: its products go, and that is said.
    table = repository.root / "data" / "starter.csv"
    table.write_text("".join(line for line in table.open() if THIRD not in line))
    assert f"does not list: {THIRD}" in repository.repro().stdout
    assert not [path for path in repository.times() if THIRD in path]
    assert repository.status() == {}


@pytest.mark.slow
def test_one_stage_makes_itself_and_what_it_reads(tmp_path):
    repository = Repository(tmp_path / "checkout")
    repository.repro(0, "views")
    made = {task.split()[0] for path in records(repository.root) for task in tasks_of(path)}
    assert made == {"objects", "views"}
    VIEWS.path(repository.root, FIRST).unlink()
    repository.repro(0, "--single-item", "views")
    assert VIEWS.path(repository.root, FIRST).is_file()


@pytest.mark.slow
@pytest.mark.parametrize("in_cache", [False, True])
def test_rotten_bits_with_size_and_time_unchanged_are_named_and_cured(repository, in_cache):
    repository.repro()
    path = VIEWS.path(repository.root, FIRST)
    whole, digest = path.read_bytes(), md5_of(path)
    cached = repository.root / ".dvc" / "cache" / "files" / "md5" / digest[:2] / digest[2:]
    remembered = memo_folder(repository.root, read_fingerprint(path)) / memo_name(path)
    rot(path)
    assert repository.status() == {}  # DVC goes by size and time
    (finding,) = repository.findings()
    assert finding.where == str(path.relative_to(repository.root))
    if in_cache:
        for copy in (cached, remembered):
            rot(copy)
        (finding,) = repository.findings()
        assert f"delete the file and {cached}, then" in finding.remedy
        assert "or run `dvc repro`" in finding.remedy
        path.unlink()
        cached.unlink()
        repository.repro()
        assert md5_of(cached) == digest
    else:
        assert "delete the file, then `dvc checkout data/views`" in finding.remedy
        path.unlink()
        repository.run("dvc", "checkout", "data/views")
    assert path.read_bytes() == whole
    assert repository.findings() == ()
    assert repository.status() == {}


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
