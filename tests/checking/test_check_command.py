"""The command: real files, exit statuses, JSON, what is not there."""

import json
from pathlib import Path

import pytest
import trimesh

from pipeline.cli import main

HEAD = (
    "id,name,mesh,texture,material,length_m,source,licence,attribution,source_id,mass_kg,mass_source,notes,"
    "accepted"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("meshes")
    block = trimesh.creation.box((0.2, 0.1, 0.1))
    block.export(folder / "block.stl")
    block.export(folder / "copy.obj")
    trimesh.creation.icosphere(2, 0.04).export(folder / "ball.stl")
    (folder / "broken.stl").write_bytes(b"solid nothing\n")
    trimesh.Trimesh(block.vertices, block.faces[:-2], process=False).export(folder / "open.stl")
    return folder


def write(folder: Path, *rows: str) -> str:
    path = folder / "objects.csv"
    path.write_text("\n".join((HEAD, *rows)) + "\n")
    return str(path)


def check(folder: Path, capsys: pytest.CaptureFixture[str], *rows: str) -> tuple[int, dict]:
    status = main(["check", write(folder, *rows), "--json"])
    return status, json.loads(capsys.readouterr().out)


BLOCK = "block,Block,block.stl,,wood,as in file,my desk,CC0-1.0,me,,1.5,scales,,"
BALL = "ball,Ball,ball.stl,,wood,0.08,my desk,CC0-1.0,me,,,,,"


def test_a_table_without_fault(folder, capsys):
    assert main(["check", write(folder, BLOCK, BALL), "--strict"]) == 0
    looks = "100 % of the area has no colour and is grey"
    summary = "2 objects, 2 measured: 0 errors, 0 warnings, 0 notes"
    assert capsys.readouterr().out == f"looks  block, ball: {looks}\n{summary}\n"
    assert check(folder, capsys, BLOCK)[1]["looks"] == {"block": looks}


def test_faults_are_told_worst_first_with_numbers_and_remedies(folder, capsys):
    rows = (
        BLOCK.replace(",1.5,", ",0.3,"),
        "broken,Broken,broken.stl,,wood,,my desk,CC0-1.0,me,,,,,",
        "copy,Copy,copy.obj,,wood,,my desk,CC0-1.0,me,,,,,",
        "open,Open,open.stl,,wood,,my desk,CC BY 4.0,,,,,,",
        "gone,Gone,gone.obj,,wood,,my desk,CC0-1.0,me,,,,,",
    )
    status, report = check(folder, capsys, *rows)
    assert status == 1
    severities = [finding["severity"] for finding in report["findings"]]
    assert severities == sorted(severities, key=["error", "warning", "note"].index)
    findings = {(finding["object_id"], finding["rule"]): finding for finding in report["findings"]}
    assert findings["broken", "readable"]["severity"] == "error"
    assert "does not exist" in findings["gone", "readable"]["found"]
    assert "shares the cleaned surface with block" in findings["copy", "duplicate"]["found"]
    assert "5 times the published 300 g" in findings["block", "mass"]["found"]
    assert "4 boundary" in findings["open", "surface"]["found"]
    assert findings["open", "licence"]["remedy"] == "Write CC-BY-4.0"
    assert (report["objects"], report["measured"]) == (5, 3)


def test_warnings_fail_a_strict_check_alone_unless_accepted(folder, capsys):
    heavy = BLOCK.replace(",1.5,", ",0.3,")
    assert main(["check", write(folder, heavy)]) == 0
    assert main(["check", write(folder, heavy), "--strict"]) == 1
    capsys.readouterr()
    accepted = heavy.removesuffix(",,") + ",hollow in truth,mass"
    assert main(["check", write(folder, accepted), "--strict"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[1].startswith("accepted  block")
    assert out.endswith("0 errors, 0 warnings, 1 note (1 accepted)\n")


def test_what_is_not_fetched_is_said_and_the_rest_is_checked(folder, capsys):
    mug = "025_mug,Porcelain mug,ycb/mug.obj,,steel,,YCB,CC-BY-4.0,Calli et al.,ycb:025_mug,,,,"
    assert main(["check", write(folder, mug)]) == 0
    out = capsys.readouterr().out
    assert "is steel, where the name" in out
    assert "1 not fetched (025_mug)" in out
    assert "objectfolder fetch --table" in out
    status, report = check(folder, capsys, mug)
    assert (status, report["unfetched"], report["measured"]) == (0, ["025_mug"], 0)


def test_the_table_alone_is_looked_at_without_its_meshes(folder, capsys):
    assert main(["check", write(folder, BLOCK.replace(",1.5,", ",0.3,")), "--no-meshes", "--strict"]) == 0
    assert "1 object, 0 measured" in capsys.readouterr().out


def test_what_is_the_same_for_many_is_said_once(folder, capsys):
    ball = BALL.replace("CC0-1.0", "CC0 1.0")
    rows = [
        ball.replace("ball,Ball", f"ball_{size},Ball").replace("ball.stl", f"{size}.stl")
        for size in (5, 6, 7)
    ]
    for size in (5, 6, 7):
        trimesh.creation.icosphere(1, 0.01 * size).export(folder / f"{size}.stl")
    assert main(["check", write(folder, *rows), "--no-meshes"]) == 0
    out = capsys.readouterr().out
    assert out.count("Write CC0-1.0") == 1
    assert "ball_5 and 2 more" in out
    assert out.endswith("3 objects, 0 measured: 0 errors, 3 warnings, 0 notes\n")


@pytest.mark.parametrize(
    ("row", "remedy"),
    [
        (BLOCK.replace("block.stl", "millimetres.stl"), "Were millimetres taken for metres? Then write 0.2"),
        (BLOCK.replace("as in file", "200"), "Were millimetres taken for metres? Then write 0.2"),
        (BLOCK.replace("block.stl", "millimetres.stl").replace("as in file", "0.2"), None),
    ],
)
def test_millimetres_taken_for_metres(folder, capsys, row, remedy):
    trimesh.creation.box((200.0, 100.0, 100.0)).export(folder / "millimetres.stl")
    status, report = check(folder, capsys, row)
    assert status == (remedy is not None)
    assert [finding["remedy"].partition(";")[0] for finding in report["findings"]] == (
        [remedy] if remedy else []
    )


def test_ids_that_differ_by_case_are_errors(folder, capsys):
    status, report = check(folder, capsys, BLOCK, BLOCK.replace("block,", "BLOCK,", 1))
    assert status == 1
    assert all(
        "case does not count" in finding["found"]
        for finding in report["findings"]
        if finding["rule"] == "readable"
    )
    assert {finding["object_id"] for finding in report["findings"] if finding["rule"] == "readable"} == {
        "block",
        "BLOCK",
    }


@pytest.mark.parametrize("text", ["", "id,mesh\na,b\n", "\0\xff"])
def test_a_table_that_cannot_be_read(tmp_path, capsys, text):
    path = tmp_path / "objects.csv"
    path.write_text(text, encoding="latin-1")
    assert main(["check", str(path)]) == 1
    assert "objects.csv" in capsys.readouterr().err
    assert main(["check", str(tmp_path / "none.csv")]) == 1


def test_a_name_that_no_file_can_have_is_an_error_of_its_row(folder, capsys):
    status, report = check(folder, capsys, BLOCK.replace("block.stl", f"{'x' * 5000}.stl"), BALL)
    assert (status, report["measured"]) == (1, 1)
    assert "does not exist" in report["findings"][0]["found"]


def test_the_papers_table_has_no_errors(capsys):
    """What is fetched of it depends on the machine; the table itself does not."""
    table = Path(__file__).parents[2] / "data" / "objects.csv"
    assert main(["check", str(table), "--no-meshes", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["objects"], report["counts"]["error"]) == (100, 0)
