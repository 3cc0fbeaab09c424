"""`objectfolder add`: one's own meshes into a table, refused with a remedy or whole."""

import json
import os
import re
import shlex
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from small_meshes import write_textured_cube

from objectfolder.making.materials import read_materials
from objectfolder.making.mesh.readers import face_count
from pipeline.cli import main
from pipeline.cluster import dask_runner
from pipeline.dataset.catalogue import read_catalogue
from pipeline.dataset.records import row_of
from pipeline.intake.add import addition
from pipeline.intake.add.addition import AddRequest, check_object, put_object
from pipeline.intake.add.table_rows import read_table
from tests.clean_forks import CLEAN

REPOSITORY = Path(__file__).parents[2]
MATERIALS = REPOSITORY / "data" / "materials.csv"


def cup(path: Path, *, scale: float = 1.0, wall: float = 0.004) -> Path:
    """An open cup of 80 mm, its wall 4 mm, in metres where scale is 1."""
    outline = [(0, 0), (0.04, 0), (0.04, 0.07), (0.04 - wall, 0.07), (0.04 - wall, wall), (0, wall)]
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh = trimesh.creation.revolve(np.array(outline), sections=32)
    mesh.apply_scale(scale)
    mesh.export(path)
    return path


def add(mesh: Path, table: Path, *options: str) -> int:
    required = {"--material": "ceramic", "--licence": "CC0-1.0", "--table": str(table)}
    words = [word for name, value in required.items() if name not in options for word in (name, value)]
    return main(["add", str(mesh), *words, *options])


def records(table: Path) -> dict:
    catalogue = read_catalogue(table, read_materials(MATERIALS))
    assert catalogue.errors == {}
    return {record.id: record for record in catalogue.records}


def request_of(mesh: Path, **more: object) -> AddRequest:
    return AddRequest(mesh=mesh, material="ceramic", licence="CC0-1.0", materials=MATERIALS, **more)


@pytest.mark.release("docs", "pipeline.intake", "pipeline.cli")
def test_the_pages_of_ones_own_objects_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cup(tmp_path / "mug.glb")
    (tmp_path / "data").mkdir()
    shutil.copy(MATERIALS, tmp_path / "data")
    pages = [(REPOSITORY / "docs" / page).read_text(encoding="utf-8") for page in ("objects.md", "make.md")]
    for page in pages:
        (line,) = re.findall(r"^objectfolder (add .*)", page, re.MULTILINE)
        shutil.rmtree(tmp_path / "data" / "my_objects", ignore_errors=True)
        (tmp_path / "data" / "my_objects.csv").unlink(missing_ok=True)
        assert main(shlex.split(line)) == 0, line
    (check,) = re.findall(r"^objectfolder (check .*)", pages[0], re.MULTILINE)
    shutil.copy("data/my_objects.csv", "data/objects.csv")
    assert main(shlex.split(check)) == 0


def test_an_axis_that_is_up_stands_in_the_row(tmp_path, capsys):
    write_textured_cube(tmp_path / "cup")
    table = tmp_path / "table.csv"
    words = ["add", str(tmp_path / "cup" / "model.obj"), "--material", "wood", "--licence", "CC0-1.0"]
    words += ["--table", str(table), "--no-preview"]
    assert main([*words, "--up", "w"]) == 2
    assert main([*words, "--up", "y"]) == 0
    assert "up           y of the file" in capsys.readouterr().out
    (record,) = read_catalogue(table, ["wood"]).records
    assert row_of(record, read_materials(MATERIALS)["wood"])["up"] == record.up == "y"


@pytest.mark.slow
def test_an_object_is_checked_copied_pictured_and_listed(tmp_path, capsys):
    mesh, table = cup(tmp_path / "in" / "My cup.ply"), tmp_path / "data" / "my_objects.csv"
    assert add(mesh, table, "--source", "turned by hand", "--roughness", "0.2") == 0
    record = records(table)["My_cup"]
    assert record.mesh == tmp_path / "data" / "my_objects" / "My_cup" / "My_cup.ply"
    assert record.mesh.read_bytes() == mesh.read_bytes()
    assert (record.name, record.material, record.length_m) == ("My cup", "ceramic", None)
    assert (record.source, record.roughness, record.metallic) == ("turned by hand", 0.2, None)
    said = capsys.readouterr().out
    # 2 pi of a wheel of 32 chords less than a circle's.
    solid = trimesh.load(mesh).volume
    for part in (
        "0.08 x 0.08 x 0.07 m",
        f"{1e6 * solid:.4g} cm3",
        f"{2700 * solid:.4g} kg",
        "closed",
        "4 mm",
    ):
        assert part in said
    assert "walls?" not in said
    assert f"make dataset OBJECTS={table} ONLY=My_cup" in said
    with Image.open(tmp_path / "data" / "my_objects" / "My_cup.png") as picture:
        assert picture.size[0] > 600


def test_adding_again_changes_nothing(tmp_path, capsys):
    mesh, table = cup(tmp_path / "cup.stl"), tmp_path / "t.csv"
    assert add(mesh, table, "--no-preview") == 0
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert add(mesh, table, "--no-preview") == 0
    assert "cup is in" in capsys.readouterr().out
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_an_id_that_is_there_is_replaced_on_demand_only(tmp_path, capsys):
    table = tmp_path / "t.csv"
    assert add(cup(tmp_path / "a" / "cup.stl"), table, "--no-preview") == 0
    mesh = cup(tmp_path / "b" / "cup.stl", wall=0.005)
    before = table.read_bytes()
    for options in ((), ("--id", "CUP")):
        assert add(mesh, table, "--no-preview", *options) == 1
        assert "--replace" in capsys.readouterr().err
        assert table.read_bytes() == before
    assert add(mesh, table, "--no-preview", "--replace") == 0
    record = records(table)["cup"]
    assert record.mesh.read_bytes() == mesh.read_bytes()
    assert len([path for path in (tmp_path / "t").iterdir() if path.is_dir()]) == 1


@pytest.mark.slow
def test_a_dry_run_writes_nothing(tmp_path, capsys):
    mesh, table = cup(tmp_path / "cup.stl"), tmp_path / "t.csv"
    assert add(mesh, table, "--dry-run") == 0
    assert "closed" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["cup.stl"]
    assert add(mesh, table, "--dry-run", "--preview", str(tmp_path / "look.png")) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cup.stl", "look.png"]
    capsys.readouterr()
    assert add(mesh, table, "--dry-run", "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["id"], figures["material"], figures["walls"]["closed"]) == ("cup", "ceramic", True)
    assert figures["looks"] == "100 % of the area has no colour and is grey"
    assert figures["extents_m"] == pytest.approx([0.08, 0.08, 0.07], rel=0.01)


@pytest.mark.parametrize(
    ("options", "status", "remedy"),
    [
        (("--material", "ceramics"), 2, "Did you mean ceramic?"),
        (("--licence", "CC BY 4.0"), 2, "Did you mean CC-BY-4.0?"),
        (("--licence", "CC-BY-4.0"), 2, "--attribution"),
        (("--length", "-1"), 2, "--length"),
        (("--length", "0.08", "--roughness", "2"), 2, "--roughness"),
        (("--wall", "0.003", "--shell", "0.003"), 2, "--shell for one that is scanned solid"),
        (("--shell", "0.05"), 1, "shell_m"),
        (("--wall", "0.05"), 1, "wall_m"),
        (("--id", "../up"), 2, "cannot be a file name"),
        (("--texture", "absent.png"), 2, "absent.png"),
        (("--name", "a\nb"), 2, "do not print"),
        (("--name", "caf\udcc3\udca9"), 2, "Set PYTHONUTF8=1"),
    ],
)
def test_what_cannot_be_made_is_refused_before_anything_is_written(tmp_path, capsys, options, status, remedy):
    mesh, table = cup(tmp_path / "cup.stl"), tmp_path / "t.csv"
    assert add(mesh, table, "--no-preview", *options) == status
    assert remedy in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["cup.stl"]


@pytest.mark.parametrize(
    ("scale", "remedy"), [(1000.0, "--length 0.08"), (1000 / 25.4, "--length 0.08")], ids=["mm", "inches"]
)
def test_a_mesh_in_another_unit_gets_the_length_to_state(tmp_path, capsys, scale, remedy):
    mesh, table = cup(tmp_path / "cup.stl", scale=scale), tmp_path / "t.csv"
    assert add(mesh, table, "--no-preview") == 1
    assert remedy in capsys.readouterr().err
    assert add(mesh, table, "--no-preview", "--length", "0.08") == 0
    assert records(table)["cup"].length_m == 0.08


@pytest.mark.parametrize("command", ["add", "build"])
def test_a_mesh_of_too_many_faces_is_refused_before_anything_begins(tmp_path, capsys, monkeypatch, command):
    monkeypatch.setattr(face_count, "MOST_FACES", 11)  # of a cube's 12
    monkeypatch.setattr(addition, "checked_object", None)
    monkeypatch.setattr(dask_runner, "DaskRunner", None)
    mesh = str(write_textured_cube(tmp_path))
    output = ("--table", str(tmp_path / "t.csv"), "--licence", "CC0-1.0")
    output = output if command == "add" else ("--output", str(tmp_path / "cube.safetensors"), "--yes")
    assert main([command, mesh, "--material", "steel", "--length", "0.1", *output]) == 1
    assert "has 12 faces, and an Object File at most" in capsys.readouterr().err


def test_a_normalised_mesh_is_asked_about(tmp_path, capsys):
    assert add(cup(tmp_path / "cup.stl", scale=12.5), tmp_path / "t.csv", "--no-preview") == 0
    warned = capsys.readouterr().out
    assert "1 m long by the file, as if normalised" in warned
    assert "kg of ceramic: is that meant? If it is in centimetres: --length 0.01" in warned


@pytest.mark.slow
def test_walls_that_cannot_be_are_said_with_the_option(tmp_path, capsys):
    box = trimesh.creation.cylinder(0.05, 0.14, sections=16)
    box.export(tmp_path / "jar.stl")
    options = ("--no-preview", "--mass", "0.4")
    assert add(tmp_path / "jar.stl", tmp_path / "t.csv", *options) == 0
    said = capsys.readouterr().out
    assert "too thick (certain)" in said
    assert "shell_m" in said
    row = next(iter(read_table(tmp_path / "t.csv").rows()))[1]
    assert row["mass_kg"] == "0.4"
    assert add(tmp_path / "jar.stl", tmp_path / "t.csv", *options, "--shell", "0.004", "--replace") == 0
    assert "walls?" not in capsys.readouterr().out
    assert records(tmp_path / "t.csv")["jar"].shell_m == 0.004


STEPS = ("locked", "copy_files", "write_table", "_remove_unused")


def killed_before(step: str, mesh: Path, table: Path, replace: bool) -> None:
    checked = check_object(request_of(mesh))
    setattr(addition, step, lambda *_: os.kill(os.getpid(), signal.SIGKILL))
    put_object(checked, table, replace=replace)
    sys.exit(7)


@pytest.mark.parametrize("replace", [False, True])
@pytest.mark.parametrize("step", STEPS)
def test_a_kill_leaves_no_row_without_its_files(tmp_path, step, replace):
    table = tmp_path / "t.csv"
    first = cup(tmp_path / "a" / "cup.stl")
    if replace:
        put_object(check_object(request_of(first)), table, replace=False)
    mesh = cup(tmp_path / "b" / "cup.stl", wall=0.005)
    process = CLEAN.Process(target=killed_before, args=(step, mesh, table, replace))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    if table.exists():
        content = records(table)["cup"].mesh.read_bytes()
        assert content == (mesh if step == "_remove_unused" else first).read_bytes()
    else:
        assert not replace
    put_object(check_object(request_of(mesh)), table, replace=True)
    assert records(table)["cup"].mesh.read_bytes() == mesh.read_bytes()


def test_a_silent_object_of_a_known_mass(tmp_path):
    mesh, table = cup(tmp_path / "in" / "cup.stl"), tmp_path / "t.csv"
    assert add(mesh, table, "--silent", "--mass", "0.1", "--no-preview") == 0
    record = records(table)["cup"]
    assert (record.senses, record.mass_kg) == (("vision", "touch"), 0.1)


def put(mesh: Path, table: Path) -> None:
    put_object(check_object(request_of(mesh)), table, replace=False)


def test_objects_added_at_the_same_time_are_all_there(tmp_path):
    table = tmp_path / "t.csv"
    meshes = [cup(tmp_path / f"cup{number}.stl", wall=0.003 + number / 1000) for number in range(4)]
    writers = [CLEAN.Process(target=put, args=(mesh, table)) for mesh in meshes]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    entries = records(table)
    assert {name: record.mesh.read_bytes() for name, record in entries.items()} == {
        mesh.stem: mesh.read_bytes() for mesh in meshes
    }


def test_a_folder_in_the_way_is_left(tmp_path):
    mesh, table = cup(tmp_path / "cup.stl"), tmp_path / "t.csv"
    (tmp_path / "t" / "cup").mkdir(parents=True)
    (tmp_path / "t" / "cup" / "precious.txt").write_text("mine")
    added = put_object(check_object(request_of(mesh)), table, replace=False)
    assert added.folder.name.startswith("cup-")
    assert (tmp_path / "t" / "cup" / "precious.txt").read_text() == "mine"
    assert records(table)["cup"].mesh.read_bytes() == mesh.read_bytes()


@pytest.mark.parametrize("object_id", ["025_mug", "Room_Essentials_Mug_White_Yellow"])
def test_scans_are_added_as_they_lie(shared_objects: Path, tmp_path, object_id):
    folder, table = shared_objects / object_id, tmp_path / "t.csv"
    options = ("--licence", "CC-BY-4.0", "--attribution", "as in the catalogue", "--no-preview")
    assert add(folder / "model.obj", table, *options) == 0
    record = records(table)[object_id]
    for path in record.mesh.parent.iterdir():
        assert path.read_bytes() == (folder / path.name).read_bytes()
    assert {path.suffix for path in record.mesh.parent.iterdir()} >= {".obj", ".mtl"}
