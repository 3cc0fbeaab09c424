"""Versions of a long table: audit, history, verify, release and get over all partitions of a checkout."""

import csv
import json
import os
from pathlib import Path

import pytest
import yaml
from versions_of_workshop import GIT, VersionedWorkshop, flip, states

from objectfolder.errors import InputError
from pipeline.audit.contents import Contents
from pipeline.audit.history import history
from pipeline.audit.verification import verify
from pipeline.cli import main
from pipeline.cli.printing import FINE
from pipeline.dataset import stages
from pipeline.dataset.lock_file import LOCK
from pipeline.dataset.manifest import MANIFEST
from pipeline.dataset.partition_folders import FOLDER, folders, partition_number
from pipeline.dataset.records import read_records, read_table, write_records
from pipeline.dataset.stages import OBJECT_FILES
from pipeline.publish.cards import single_objects
from pipeline.publish.report.partition_index import write_partition_index

PARTITIONS = 2
MATERIALS = {"cup": "steel", "dish": "wood", "bowl": "iron", "jug": "glass", "fork": "steel"}
IGNORED = "data/*/\nobject_files/\n.objectfolder/\n"


class PartitionedWorkshop(VersionedWorkshop):
    """A workshop whose objects lie in partitions from its second version on."""

    parted = False

    def lock(self) -> None:
        """Write the records, locks and figures of each partition in place of those of the checkout."""
        super().lock()
        if not self.parted:
            return
        (self.root / "dvc.lock").unlink()
        (self.root / FOLDER).mkdir(exist_ok=True)
        (self.root / FOLDER / ".gitignore").write_text(IGNORED)
        records = read_table(self.root, self.parameters.objects)
        for number in range(PARTITIONS):
            own = self.root / FOLDER / f"{number:03}"
            ids = {name for name in records.rows if partition_number(name, PARTITIONS) == number}
            outs = {
                stage.name: [self._moved(kind, own, ids) for kind in stage.products] for stage in self.stages
            }
            self._write(own, ids, outs)
        write_partition_index(self.root)

    def _moved(self, kind, own: Path, ids: set[str]) -> dict[str, object]:
        """Link the products of objects into the folder of their partition, and keep them."""
        (own / kind.folder).mkdir(parents=True, exist_ok=True)
        for path in (own / kind.folder).iterdir():
            path.unlink()
        for object_id in ids:
            os.link(kind.path(self.root, object_id), kind.path(own, object_id))
        return self._kept(str(own.relative_to(self.root) / kind.folder)) | {"path": kind.folder}

    def _write(self, own: Path, ids: set[str], outs: dict[str, list[dict[str, object]]]) -> None:
        seed = {"../../params.yaml": {"seed": self.parameters.seed}}
        entries = {name: {"cmd": "make", "params": seed, "outs": out} for name, out in outs.items()}
        (own / "dvc.lock").write_text(yaml.safe_dump({"schema": "2.0", "stages": entries}))
        declared = {
            name: {
                "cmd": "make",
                "params": [{"../../params.yaml": ["seed"]}],
                "outs": [o["path"] for o in out],
            }
            for name, out in outs.items()
        }
        (own / "dvc.yaml").write_text(yaml.safe_dump({"stages": declared}))
        for name in ("params.yaml", "data/card.yaml"):
            if (self.root / name).exists() and not (own / name).exists():
                (own / name).symlink_to(os.path.relpath(self.root / name, (own / name).parent))
        records = read_table(self.root, self.parameters.objects)
        write_records(own, records.selected(ids))
        (own / "reports").mkdir(exist_ok=True)
        with (own / "reports/per_object.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("id", "audio.audible", "vision.psnr_db", "cpu_seconds.views"))
            writer.writerows((name, 1, 40.0 + len(name), 2.5) for name in sorted(ids))
        (own / MANIFEST).write_text(json.dumps({"stages": {}}))


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    """Three versions: whole, in partitions, and there with a cup of another material."""
    root = tmp_path_factory.mktemp("partitions") / "checkout"
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(root))
        checkout = PartitionedWorkshop(root, "workshop_of_partitions")
        for object_id, material in MATERIALS.items():
            checkout.add(object_id, material)
        (root / "data/card.yaml").write_text("title: Cups\ncreators: [A. Maker]\nversion: 0.1.0\n")
        commits = [checkout.version("whole")]
        checkout.parted = True
        commits.append(checkout.version("in partitions"))
        checkout.row("cup")["material"] = "glass"
        checkout.save()
        commits.append(checkout.version("a glass cup"))
        yield checkout, commits


def test_objects_lie_in_more_than_one_partition(workshop):
    checkout, _ = workshop
    assert [len(read_records(own).rows) for own in folders(checkout.root)] == [1, 4]


def test_an_audit_joins_the_partitions(workshop):
    checkout, (whole, partitions, glass) = workshop
    audit = checkout.audit(whole, partitions)
    assert set(states(audit).values()) == {"unchanged"}, "the same products in other folders"
    assert (audit.problems, audit.not_compared, audit.fetch.files) == ((), (), 0)
    changed, alone = (
        checkout.audit(partitions, glass, arrays=True),
        checkout.audit(whole, glass, arrays=True),
    )
    assert states(changed) == {name: "changed" if name == "cup" else "unchanged" for name in MATERIALS}
    assert changed.objects == alone.objects
    assert {"modes", "fidelity"} <= {stage.stage for stage in changed.objects[1].stages}
    assert "material" in str(changed.objects[1].roots)
    assert changed.fetch.files > 0
    assert set(states(checkout.audit(glass)).values()) == {"unchanged"}, "as it lies in the work tree"


def test_history_follows_an_object_into_its_partition(workshop):
    checkout, (whole, _, glass) = workshop
    with Contents(checkout.root) as contents:
        versions, unreadable = history(contents, "cup", checkout.stages)
        assert [version.commit.hash for version in versions] == [whole, glass]
        assert unreadable == []
        assert [len(history(contents, name, checkout.stages)[0]) for name in ("dish", "fork")] == [
            1,
            1,
        ]
        with pytest.raises(InputError, match="no version behind HEAD has it"):
            history(contents, "spoon", checkout.stages)


def test_damage_in_a_partition_is_named_by_its_path(workshop):
    checkout, (_, _, glass) = workshop
    with Contents(checkout.root) as contents:
        for revision in (None, glass):
            result = verify(contents, checkout.at(contents, revision), checkout.stages)
            assert result.findings == ()
            assert result.files > len(MATERIALS) * len(checkout.stages)
        (own,) = (own for own in folders(checkout.root) if OBJECT_FILES.path(own, "cup").is_file())
        path = OBJECT_FILES.path(own, "cup")
        before = path.read_bytes()
        flip(path, 8 * (len(before) - 1))
        try:
            findings = verify(contents, checkout.at(contents, None), checkout.stages).findings
        finally:
            path.write_bytes(before)
        assert {finding.where for finding in findings} == {str(path.relative_to(checkout.root))}
        lock = folders(checkout.root)[-1] / LOCK
        text = lock.read_text()
        lock.write_text("schema: [")
        try:
            findings = verify(contents, checkout.at(contents, None), checkout.stages).findings
        finally:
            lock.write_text(text)
        assert LOCK in {finding.where for finding in findings}


def test_single_objects_are_fetched_of_any_partition(workshop, tmp_path):
    checkout, (_, partitions, glass) = workshop
    for revision in (partitions, glass):
        got = list(single_objects.get(f"{checkout.root}@{revision}", ["cup", "dish"], tmp_path / revision))
        assert [(entry.object_id, entry.outcome) for entry in got] == [
            ("cup", "fetched"),
            ("dish", "fetched"),
        ]
    whole = {
        path.name for path in (entry.path for entry in single_objects.get(str(checkout.root), [], tmp_path))
    }
    assert whole == {f"{name}.safetensors" for name in MATERIALS}
    with pytest.raises(InputError, match=r"no object 'cap'.*Near are cup"):
        list(single_objects.get(str(checkout.root), ["cap"], tmp_path))


def test_a_release_has_all_partitions(workshop, tmp_path, monkeypatch, capsys):
    checkout, _ = workshop
    for name, value in GIT.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(stages, "STAGES", {stage.name: stage for stage in checkout.stages})
    monkeypatch.chdir(checkout.root)
    status = main(["release", "v1", "-o", str(tmp_path / "hub")])
    out, error = capsys.readouterr()
    assert status == FINE, error
    assert "v1: 5 objects, 5 changed" in out
    assert checkout.git("status", "--porcelain", "--untracked-files=no") == ""
    rows = csv.DictReader(checkout.git("show", "v1:reports/object_versions.csv").splitlines())
    assert {row["object"] for row in rows} == set(MATERIALS)
    figures = list(csv.DictReader(checkout.git("show", "v1:reports/per_object.csv").splitlines()))
    assert [row["id"] for row in figures] == sorted(MATERIALS)
    card = json.loads(checkout.git("show", "v1:reports/croissant.json"))
    paths = {node["contentUrl"] for node in card["distribution"] if "contentUrl" in node}
    files = {str(path.relative_to(tmp_path / "hub")) for path in (tmp_path / "hub").rglob("*.safetensors")}
    assert len(files) == len(MATERIALS)
    assert all(any(path.endswith(name) for path in paths) for name in files), "cards name the files by path"
