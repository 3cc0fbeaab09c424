"""Rows put into tables of objects: other rows keep their bytes, whoever writes at the same time."""

import csv
import io
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from objectfolder.errors import InputError
from pipeline.intake.add.table_rows import locked, read_table, with_row, write_table
from tests.clean_forks import CLEAN

ROW = {"id": "mug", "name": "A mug", "mesh": "mug/model.obj", "material": "ceramic", "licence": "CC0-1.0"}


def cells(text: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline=""), strict=True))


def test_a_table_that_is_not_there_is_made(tmp_path):
    text = with_row(read_table(tmp_path / "new.csv"), ROW)
    header, row = cells(text)
    assert header[:3] == ["id", "name", "mesh"]
    assert dict(zip(header, row, strict=True))["material"] == "ceramic"
    assert text.endswith("\n")


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize("last_line_ends", [True, False])
def test_other_rows_keep_their_bytes(tmp_path, end, mark, last_line_ends):
    lines = [
        "notes,material,id,mesh,licence",
        'said "yes" once,wood,a,"b,c/model.obj",CC0-1.0',
        '"two' + end + 'lines, ""quoted""",steel, d ,d.obj,',
        "",
        "short,iron,e",
    ]
    lines[1] = '"said ""yes"" once",wood,a,"b,c/model.obj",CC0-1.0'
    before = mark + end.join(lines) + (end if last_line_ends else "")
    path = tmp_path / "table.csv"
    path.write_bytes(before.encode())
    table = read_table(path)
    assert [row["id"] for _, row in table.rows()] == ["a", "d", "e"]
    # The column `name` is new: it goes to the end of the header, and nothing else moves.
    after = with_row(table, ROW)
    first, rest = before.split(end, 1)
    assert after.startswith(f"{first},name{end}{rest}")
    added = after[len(f"{first},name{end}{rest}") :]
    assert added.removeprefix(end) == f",ceramic,mug,mug/model.obj,CC0-1.0,A mug{end}"


def test_a_replaced_row_keeps_cells_that_are_not_the_objects(tmp_path):
    path = tmp_path / "table.csv"
    before = "id,mesh,material,notes\na,a.obj,wood,keep\nMug,old.obj,steel,mine\nz,z.obj,iron,keep\n"
    path.write_text(before)
    table = read_table(path)
    index, old = table.row_of("mug")
    assert old["mesh"] == "old.obj"
    text = with_row(table, {"id": "mug", "mesh": "new.obj", "material": "ceramic"}, index)
    assert text == before.replace("Mug,old.obj,steel,mine", "mug,new.obj,ceramic,mine")


texts = st.text(st.characters(codec="utf-8", exclude_characters="\x00"), max_size=12)


@pytest.mark.slow
@example([], "\n", "\r")
@example([], "\n", "\r\nz")
@given(st.lists(st.lists(texts, min_size=4, max_size=4), max_size=4), st.sampled_from(["\n", "\r\n"]), texts)
def test_any_cells_survive(tmp_path_factory, rows, end, name):
    path = tmp_path_factory.mktemp("table") / "t.csv"
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator=end)
    writer.writerow(["id", "mesh", "material", "odd"])
    writer.writerows(rows)
    path.write_bytes(text.getvalue().encode())
    after = with_row(read_table(path), {**ROW, "name": f"x{name}"})
    assert cells(after)[1:-1] == cells(text.getvalue())[1:]
    assert dict(zip(*[cells(after)[i] for i in (0, -1)], strict=False))["name"] == f"x{name}"


@pytest.mark.parametrize(
    ("content", "finding"),
    [
        (b'id,mesh,material\na,"b,c\n', "is not a CSV table"),
        (b"id,mesh,material\n\xff\xfe,b,c\n", "is not a CSV table"),
        (b"id,material\na,wood\n", "has no column 'mesh'"),
    ],
    ids=["open quote", "no UTF-8", "meshes by folder"],
)
def test_tables_that_cannot_be_edited_are_refused(tmp_path, content, finding):
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=finding):
        read_table(path)


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real.csv").write_text("id,mesh,material\n")
    (tmp_path / "link.csv").symlink_to("real.csv")
    write_table(tmp_path / "link.csv", with_row(read_table(tmp_path / "link.csv"), ROW))
    assert (tmp_path / "link.csv").is_symlink()
    assert "mug" in (tmp_path / "real.csv").read_text()


def add_rows(path: Path, writer: int, count: int) -> None:
    for number in range(count):
        with locked(path):
            table = read_table(path)
            write_table(path, with_row(table, {**ROW, "id": f"w{writer}_{number}"}))


def test_rows_added_at_the_same_time_are_all_there(tmp_path):
    path = tmp_path / "table.csv"
    writers = [CLEAN.Process(target=add_rows, args=(path, writer, 8)) for writer in range(4)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    ids = sorted(row["id"] for _, row in read_table(path).rows())
    assert ids == sorted(f"w{writer}_{number}" for writer in range(4) for number in range(8))
