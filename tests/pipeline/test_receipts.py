"""The quick look of the stages that own folders."""

import csv
import json

import pytest

from pipeline.dataset.manifest import Entry
from pipeline.dataset.verified import Verified
from pipeline.run.record import is_recorded, receipt_path, write_receipt

FOLDERS = ("object_files", "fidelity")


@pytest.fixture
def root(tmp_path):
    """Two products of two objects each that the manifest lists, with MD5 known, and a failure."""
    verified = Verified(tmp_path)
    entries = [Entry("mug", "fidelity", "", "f" * 64, failure="no mesh")]
    for folder in FOLDERS:
        (tmp_path / "data" / folder).mkdir(parents=True)
        for name in ("bowl", "cup"):
            path = tmp_path / "data" / folder / name
            path.write_text(f"{folder} {name}")
            where = f"data/{folder}/{name}"
            entries.append(Entry(name, "fidelity", where, "f" * 64, verified.md5(path), 1))
            verified.source_digest(path)
    verified.add(tmp_path / "data/fidelity/cup", "f" * 64)
    verified.save()
    with (tmp_path / "data" / "products.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, vars(entries[0]))
        writer.writeheader()
        writer.writerows(map(vars, entries))
    return tmp_path


def test_products_as_the_manifest_lists_them_are_recorded(root):
    assert is_recorded(root, "fidelity")


def test_other_products_are_not(root):
    assert not is_recorded(root, "views")
    more = root / "data/fidelity/plate"
    more.write_text("not listed")
    assert not is_recorded(root, "fidelity")
    more.unlink()
    (root / "data/object_files/cup").write_text("changed since")
    assert not is_recorded(root, "fidelity")
    (root / "data/object_files/cup").unlink()
    assert not is_recorded(root, "fidelity")


def test_a_receipt_is_the_stages_part_of_the_manifest(tmp_path):
    (tmp_path / "data").mkdir()
    parts = {"views": {"digest": "1", "failed": 0}, "modes": {"digest": "2", "failed": 1}}
    (tmp_path / "data/manifest.json").write_text(json.dumps({"stages": parts}))
    write_receipt(tmp_path, "modes")
    assert json.loads((tmp_path / receipt_path("modes")).read_text()) == parts["modes"]
