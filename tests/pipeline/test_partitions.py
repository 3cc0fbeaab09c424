"""A long table in partitions: each object in one, and only those run whose inputs changed."""

import csv
import json
import shutil
from pathlib import Path

import pytest
import yaml
from repositories import opened

from bench.factory import overhead_repository
from bench.factory.overhead_repository import MESH, REPOSITORY, OverheadRepository
from objectfolder.errors import InputError
from pipeline.dataset.manifest import MANIFEST, Entry
from pipeline.dataset.partition_folders import FOLDER, folders
from pipeline.dataset.selection import select
from pipeline.publish.report.partition_index import write_partition_index
from pipeline.run.partitions import partition, write_partition_inputs
from pipeline.run.run_record import records
from pipeline.run.source_digests import write_inputs
from pipeline.run.stage_run import make_products
from pipeline.run.status import status
from pipeline.store.product_cache import ProductCache

OBJECTS = 24
TABLE = "data/starter.csv"


@pytest.fixture
def root(tmp_path) -> Path:
    """A checkout of a table, without code."""
    for name in ("dvc.yaml", "params.yaml", "data/materials.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(REPOSITORY / name, tmp_path / name)
    (tmp_path / "meshes").mkdir()
    with (tmp_path / TABLE).open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("id", "mesh", "material", "own column"))
        for number in range(OBJECTS):
            (tmp_path / f"meshes/{number}.obj").write_text(MESH.format(size=0.1 + 0.01 * number))
            writer.writerow((f"object_{number}", f"../meshes/{number}.obj", "steel", f"note, {number}"))
    return tmp_path


def ids_of(folder: Path) -> set[str]:
    """The objects in the table of a partition."""
    with (folder / TABLE).open(newline="") as file:
        return {row["id"] for row in csv.DictReader(file)}


def contents(root: Path, name: str) -> list[dict]:
    """A JSON file of each partition."""
    return [json.loads((folder / name).read_text()) for folder in folders(root)]


def test_partitions_have_each_object_once_as_the_whole_table_has_it(root):
    partition(root, 6)
    write_partition_inputs(root)
    write_inputs(root)
    digests, stated = contents(root, "data/inputs.json"), contents(root, "data/records.json")
    assert len(digests) == 4
    assert sum(map(len, digests)) == OBJECTS
    # What products are made from is the same, so their bytes are.
    assert {name: digest for part in digests for name, digest in part.items()} == json.loads(
        (root / "data/inputs.json").read_text()
    )
    assert {name: row for part in stated for name, row in part["objects"].items()} == json.loads(
        (root / "data/records.json").read_text()
    )["objects"]
    assert "own column" in (folders(root)[0] / TABLE).read_text()


def test_a_mesh_concerns_its_partition_alone(root):
    partition(root, 6)
    write_partition_inputs(root)
    before = contents(root, "data/inputs.json")
    mesh = root / "meshes/7.obj"
    mesh.write_text(mesh.read_text().replace("0 0 0", "0 0 0.01"))
    write_partition_inputs(root)
    changed = [old != new for old, new in zip(before, contents(root, "data/inputs.json"), strict=True)]
    assert sum(changed) == 1
    assert "object_7" in before[changed.index(True)]


def test_more_objects_split_partitions_in_two(root):
    partition(root, 12)
    write_partition_inputs(root)
    first, second = map(ids_of, folders(root))
    entry = Entry("object_0", "views", "data/views/object_0.zarr.zip", "f" * 64, "0" * 32, 1)
    old = folders(root)[0 if "object_0" in first else 1]
    (old / "data/products.csv").write_text(
        "object,stage,path,fingerprint,md5,bytes,failure\n" + ",".join(map(str, vars(entry).values())) + "\n"
    )
    partition(root, 6)
    write_partition_inputs(root)
    parts = [ids_of(folder) for folder in folders(root)]
    assert (parts[0] | parts[1], parts[2] | parts[3]) == (first, second)
    # The partition that an object goes to knows its products in DVC's cache.
    for folder, ids in zip(folders(root), parts, strict=True):
        cache = ProductCache(folder)
        target = folder / entry.path
        cache.path(entry.md5).parent.mkdir(parents=True, exist_ok=True)
        cache.path(entry.md5).touch()
        assert bool(cache.files(entry.fingerprint, [target])) == ("object_0" in ids)
    # Fewer objects do not: nothing would be gained.
    assert len(partition(root, OBJECTS).objects) == 4


def test_a_table_without_meshes_and_textures_beside_it(root):
    folder = root / "data" / "object_1"
    folder.mkdir()
    shutil.copy(root / "meshes/1.obj", folder / "model.obj")
    (folder / "skin.png").touch()
    (root / TABLE).write_text("id,texture,material\nobject_1,skin.png,steel\n")
    partition(root, 1)
    assert not folders(root), "one object is one data set"
    (root / TABLE).write_text("id,texture,material\nobject_1,skin.png,steel\nobject_2,,steel\n")
    shutil.copytree(folder, root / "data" / "object_2")
    partition(root, 1)
    write_partition_inputs(root)
    (own,) = (part["object_1"] for part in contents(root, "data/inputs.json") if "object_1" in part)
    write_inputs(root)
    assert own == json.loads((root / "data/inputs.json").read_text())["object_1"]


def test_what_cannot_be_cut_is_refused(root):
    with pytest.raises(InputError, match="there are no partitions"):
        write_partition_inputs(root)
    with pytest.raises(InputError, match="no object of 24 goes to"):
        partition(root, 1)
    parameters = root / "params.yaml"
    inside = parameters.read_text()
    parameters.write_text(inside.replace(f"table: {TABLE}", f"table: {root / TABLE}"))
    with pytest.raises(InputError, match="outside the checkout"):
        partition(root, 6)
    parameters.write_text(inside)
    partition(root, 6)
    for command in (make_products, status):
        with pytest.raises(InputError, match=f"products are in {FOLDER}/"):
            command(root)
    with pytest.raises(InputError, match="is a partition"):
        select(folders(root)[0], str(root / TABLE), None)


def test_the_page_of_all_partitions_has_the_figures_of_one_report(root):
    partition(root, 12)
    values = {"000": [("", 40.0, -30.0), ("0", 31.0, -9.0)], "001": [("1", 34.0, -50.0)]}
    for name, rows in values.items():
        folder = root / FOLDER / name
        (folder / "reports").mkdir()
        with (folder / "reports/per_object.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("id", "audio.audible", "vision.psnr_foreground_db", "audio.gain_error_db"))
            writer.writerows((f"{name}-{index}", *row) for index, row in enumerate(rows))
        summary = {"digest": "", "products": len(rows), "bytes": 10**6, "failed": 0}
        (folder / MANIFEST).write_text(json.dumps({"stages": {"views": summary}}))
    write_partition_index(root)
    metrics = json.loads((root / FOLDER / "metrics.json").read_text())
    assert (metrics["objects"], metrics["failed"], metrics["audio"]["silent_objects"]) == (3, 0, 1)
    assert metrics["vision"]["psnr_foreground_db"] == {"mean": 35.0, "worst": 31.0}
    assert metrics["audio"]["gain_error_db"] == {"mean": -40.0, "worst": -30.0}, "silent objects leave it"
    assert metrics["touch"]["psnr_contact_db"] == {"mean": None, "worst": None}
    page = (root / FOLDER / "index.html").read_text()
    assert all(f'href="{name}/reports/index.html"' in page for name in values)


@pytest.mark.slow
@pytest.mark.release("pipeline.run")
def test_dvc_runs_the_partitions_that_changed(tmp_path, monkeypatch):
    monkeypatch.setattr(overhead_repository, "CHUNKS", {})
    monkeypatch.delenv("PYTHONPATH", raising=False)
    repository = OverheadRepository(tmp_path, 6)
    stages = yaml.safe_load((tmp_path / "dvc.yaml").read_text())
    for name in ("starter", "report"):  # what is not of these objects, and what has tests of its own
        del stages["stages"][name]
    stages["stages"]["failures"]["deps"].remove("reports/index.html")
    (tmp_path / "dvc.yaml").write_text(yaml.safe_dump(stages))
    repository.run("python", "-m", "pipeline.cli", "partition", "--objects", "3")
    common = yaml.safe_load((tmp_path / FOLDER / "dvc.yaml").read_text())
    del common["stages"]["index"]
    (tmp_path / FOLDER / "dvc.yaml").write_text(yaml.safe_dump(common))

    def repro() -> list[Path]:
        """Run DVC; return the partitions that made products."""
        before = [set(records(folder)) for folder in folders(tmp_path)]
        repository.run("dvc", "repro", "-q", "-R", str(FOLDER))
        with opened(tmp_path) as dvc:
            assert not dvc.status(targets=[str(FOLDER)], recursive=True)
        return [
            folder
            for folder, earlier in zip(folders(tmp_path), before, strict=True)
            if set(records(folder)) - earlier
        ]

    assert repro() == folders(tmp_path)
    names = {path.name for folder in folders(tmp_path) for path in (folder / "data/fidelity").glob("*.zip")}
    assert names == {f"{object_id}.zarr.zip" for object_id in repository.ids}
    repository.write_mesh(repository.ids[0], 0.5)
    (changed,) = repro()
    assert (changed / "data/fidelity" / f"{repository.ids[0]}.zarr.zip").exists()
