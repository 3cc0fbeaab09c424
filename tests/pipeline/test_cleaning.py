"""What `clean` lists and removes, and what it never touches."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from objectfolder.products.store import Product
from pipeline.cli import main
from pipeline.dataset.stages import OBJECT_FILES, VIEWS
from pipeline.run import run_record
from pipeline.sandbox import scratch
from pipeline.sandbox.child import write_content

HELD = """
import sys, time
from pathlib import Path
from pipeline.run.exclusive import exclusive
with exclusive(Path.cwd(), "views"):
    print("held", flush=True)
    sys.stdin.read()
"""


def run(root, *arguments):
    return main(["clean", "--root", str(root), *arguments])


@pytest.fixture
def used(tmp_path, monkeypatch):
    """A data set after long use: whole files, half-written ones, and what dead processes left."""
    root = tmp_path / "set"
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    monkeypatch.setattr(run_record, "MOST_RUNS", 2)
    for kind in (VIEWS, OBJECT_FILES):
        (root / kind.folder).mkdir(parents=True)
    write_content(VIEWS.path(root, "mug"), Product({}, {}), "a" * 64, {})
    for name in (
        f"{VIEWS.folder}/.mug.zarr.zip.x1.partial",
        f"{OBJECT_FILES.folder}/.mug.safetensors.x2.partial",
        ".objectfolder/.verified.json.x3.partial",
        ".objectfolder/shared-0a",
        ".objectfolder/players/0a.1",
        ".objectfolder/memo/0a/views.zarr.zip",  # as earlier versions kept products
        ".objectfolder/costs.csv",
        ".objectfolder/verified.json",
        "runs/20260101T000000Z-aa.jsonl",
        "runs/20260102T000000Z-aa.jsonl",
        "runs/20260103T000000Z-aa.jsonl",
        "runs/notes.json",
        "reports/index.html",
        "reports/.odd.partial",
        "reports/.kept.partial",
        "data/notes.txt",
        "data/records.json",
        "own/.mine.partial",
    ):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("x" * 5000)
    (root / "dvc.lock").write_text(
        yaml.safe_dump(
            {
                "schema": "2.0",
                "stages": {"views": {"cmd": "x", "outs": [{"path": "runs/20260101T000000Z-aa.jsonl"}]}},
            }
        )
    )
    for command in (["init", "-q"], ["add", "-f", "dvc.lock", "reports/.kept.partial", "data/notes.txt"]):
        subprocess.run(["git", *command], cwd=root, check=True)
    dead = subprocess.run(
        [
            sys.executable,
            "-c",
            "from pipeline.sandbox.scratch import KEYS, Scratch; import os; it = Scratch(); "
            "KEYS.mkdir(); keys = Scratch('keys', KEYS); open(keys.name + '/key', 'w').close(); "
            "open(it.name + '/big', 'wb').write(bytes(10**6)); print(it.name, flush=True); os._exit(0)",
        ],
        cwd=root,
        env={**os.environ, "TMPDIR": str(temporary), "PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    return root, Path(dead)


def files(root):
    """Return all files but git's own and the lock that every run makes."""
    paths = (path for path in root.rglob("*") if path.is_file() and ".git" not in path.parts)
    return {path.relative_to(root).as_posix() for path in paths} - {".objectfolder/run.lock"}


def test_nothing_is_removed_unless_asked_for(used, capsys):
    root, dead = used
    before = files(root)
    assert run(root) == 0
    assert run(root, "--dry-run") == 0
    assert files(root) == before
    assert dead.exists()
    shown = capsys.readouterr().out
    for text in (
        "half-written files",
        "scratch folders",
        "marks of runs",
        "run again with --yes",
        "dvc gc",
        "1.0 MB",
    ):
        assert text in shown
    assert str(root) not in shown
    assert run(root, "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    assert not figures["removed"]
    assert figures["bytes"] == sum(kind["bytes"] for kind in figures["kinds"]) > 1_000_000
    assert "half-written files" in {kind["kind"] for kind in figures["kinds"]}


def test_no_command_that_a_repository_names_runs(used, tmp_path):
    root, _ = used
    command = ["git", "config", "core.fsmonitor", f"touch {tmp_path}/mark #"]
    subprocess.run(command, cwd=root, check=True)
    assert run(root) == 0
    assert not (tmp_path / "mark").exists()


def test_what_is_left_over_goes_and_all_else_stays(used, capsys):
    root, dead = used
    living = scratch.Scratch()
    before = files(root)
    assert run(root, "--yes") == 0
    gone = before - files(root)
    (key,) = (path for path in gone if path.startswith(str(scratch.KEYS)))
    assert gone - {key} == {
        f"{VIEWS.folder}/.mug.zarr.zip.x1.partial",
        f"{OBJECT_FILES.folder}/.mug.safetensors.x2.partial",
        ".objectfolder/.verified.json.x3.partial",
        ".objectfolder/shared-0a",
        ".objectfolder/players/0a.1",
        ".objectfolder/memo/0a/views.zarr.zip",
        "reports/.odd.partial",
    }  # the oldest record is an output of DVC's in this set
    assert not dead.exists()
    assert Path(living.name).exists()
    living.cleanup()
    capsys.readouterr()
    assert run(root, "--yes") == 0
    assert "nothing to remove" in capsys.readouterr().out


def test_old_records_go_where_nothing_names_them(used):
    root, _ = used
    (root / "dvc.lock").unlink()
    run(root, "--yes")
    assert [path.name[:8] for path in run_record.records(root)] == ["20260102", "20260103"]


def test_refused_while_a_run_goes_on(used, capsys):
    root, dead = used
    run_going_on = subprocess.Popen(
        [sys.executable, "-c", HELD],
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert run_going_on.stdout.readline() == "held\n"
    assert run(root, "--yes") == 1
    assert f"in use by process {run_going_on.pid}" in capsys.readouterr().err
    assert dead.exists()
    run_going_on.communicate("")
    assert run(root, "--yes") == 0
    assert not dead.exists()


def test_contradicting_options_and_a_broken_lock_remove_nothing(used, capsys):
    root, dead = used
    assert run(root, "--yes", "--dry-run") == 2
    (root / "dvc.lock").write_text("stages: [")
    assert run(root, "--yes") == 1
    assert "not a lock file of DVC" in capsys.readouterr().err
    assert dead.exists()
