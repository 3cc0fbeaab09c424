"""The line after a run: what it recorded other than git has it, and why."""

import hashlib
import json

import pygit2
import pytest
import yaml

from pipeline.audit.recorded_outputs import difference

SIGNATURE = pygit2.Signature("t", "t@t")
CODE, OUT = "0" * 32, "1" * 32


def write(root, psnr_db=46.0, seconds=3.0, code=CODE, seed=0):
    """Write a lock file and a report, all of which git has."""
    (root / "reports").mkdir(exist_ok=True)
    metrics = json.dumps({"vision": {"psnr_foreground_db": {"mean": psnr_db}}})
    (root / "reports" / "metrics.json").write_text(metrics)
    (root / "reports" / "per_object.csv").write_text(f"id,cpu_seconds.views\nmug,{seconds}\n")
    stage = {
        "cmd": "make",
        "deps": [{"path": "objectfolder", "md5": code}, {"path": "data/views", "md5": str(psnr_db)}],
        "params": {"params.yaml": {"seed": seed}},
        "outs": [{"path": f"reports/{name}", "md5": OUT} for name in ("metrics.json", "per_object.csv")],
    }
    digest = hashlib.md5(str(psnr_db).encode()).hexdigest()
    views = {"cmd": "make", "outs": [{"path": "data/views", "md5": f"{digest}.dir"}]}
    lock = {"schema": "2.0", "stages": {"views": views, "report": stage}}
    (root / "dvc.lock").write_text(yaml.safe_dump(lock))


@pytest.fixture
def root(tmp_path):
    write(tmp_path)
    git = pygit2.init_repository(str(tmp_path))
    git.index.add_all()
    git.create_commit("HEAD", SIGNATURE, SIGNATURE, "first", git.index.write_tree(), [])
    return tmp_path


def test_nothing_is_said_of_a_clean_tree_and_of_none(root, tmp_path_factory):
    assert difference(root) == ""
    assert difference(tmp_path_factory.mktemp("outside")) == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"psnr_db": 45.9}, ["vision.psnr_foreground_db 46.00 -> 45.90", "another processor"]),
        (
            {"seconds": 4.0},
            ["1 recorded file differs from HEAD (reports/per_object.csv): CPU seconds. Why: times"],
        ),
        ({"code": "2" * 32}, ["Why: objectfolder changed after they were recorded."]),
        ({"seed": 1}, ["Why: other parameters (seed)."]),
    ],
)
def test_a_line_says_what_differs_and_why(root, change, words):
    write(root, **change)
    line = difference(root)
    assert "\n" not in line
    assert all(word in line for word in words), line
