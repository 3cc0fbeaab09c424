"""What is known of files is a sorted table that is added to and never silently changed."""

import subprocess
import sys

import pytest

from objectfolder.errors import InputError
from pipeline.intake.sources.recorded_hashes import ChangedError, Content, read_hashes, record_hashes
from pipeline.intake.sources.registry import SOURCES
from tests.conftest import REPOSITORY

A, B = Content(3, "a" * 64), Content(4, "b" * 64)
HEADER = "source_id,file,bytes,sha256\n"


def test_rows_are_added_once_and_lie_sorted(tmp_path):
    table = tmp_path / "source_hashes.csv"
    assert record_hashes(table, "ycb:b", {"z, z": A, "a": B}) == 2
    assert record_hashes(table, "gso:é", {"m": A}) == 1
    assert record_hashes(table, "ycb:b", {"a": B}) == 0
    assert table.read_text(encoding="utf-8") == (
        HEADER + f"gso:é,m,3,{A.sha256}\nycb:b,a,4,{B.sha256}\n" + f'ycb:b,"z, z",3,{A.sha256}\n'
    )
    assert read_hashes(table) == {("ycb:b", "z, z"): A, ("ycb:b", "a"): B, ("gso:é", "m"): A}
    assert set(tmp_path.iterdir()) == {table, tmp_path / ".source_hashes.csv.lock"}


def test_other_content_is_refused_and_nothing_written_until_accepted(tmp_path):
    table = tmp_path / "source_hashes.csv"
    record_hashes(table, "ycb:b", {"a": A})
    before = table.read_bytes()
    with pytest.raises(ChangedError, match=f"{B.sha256}.*{A.sha256}"):
        record_hashes(table, "ycb:b", {"a": B, "new": A})
    assert table.read_bytes() == before
    assert record_hashes(table, "ycb:b", {"a": B, "new": A}, accept_changed=True) == 2
    assert read_hashes(table) == {("ycb:b", "a"): B, ("ycb:b", "new"): A}


def test_a_size_alone_that_differs_is_another_content(tmp_path):
    table = tmp_path / "source_hashes.csv"
    record_hashes(table, "ycb:b", {"a": A})
    with pytest.raises(ChangedError):
        record_hashes(table, "ycb:b", {"a": Content(A.bytes + 1, A.sha256)})


@pytest.mark.parametrize(
    "text",
    [
        "source_id,file,sha256,bytes\n",
        HEADER + "ycb:b,a,3\n",
        HEADER + "ycb:b,a,3,abc\n",
        HEADER + f"ycb:b,a,three,{A.sha256}\n",
        HEADER + f"ycb:b,a,3,{A.sha256}\nycb:b,a,3,{B.sha256}\n",
        HEADER + '"ycb:b\n',
    ],
)
def test_a_damaged_table_is_refused_and_left_alone(tmp_path, text):
    table = tmp_path / "source_hashes.csv"
    table.write_text(text, encoding="utf-8")
    with pytest.raises(InputError):
        record_hashes(table, "ycb:b", {"new": A})
    assert table.read_text(encoding="utf-8") == text


def test_a_table_in_another_encoding_is_refused(tmp_path):
    table = tmp_path / "source_hashes.csv"
    table.write_bytes(HEADER.encode() + b"\xff\xfe\n")
    with pytest.raises(InputError, match="not a CSV table of hashes in UTF-8"):
        read_hashes(table)


MANY = """
import sys
from pathlib import Path
from pipeline.intake.sources.recorded_hashes import Content, record_hashes
for number in range(20):
    record_hashes(Path(sys.argv[1]), "ycb:" + sys.argv[2], {f"{number:02}": Content(3, "a" * 64)})
"""


def test_processes_that_add_at_once_lose_nothing(tmp_path):
    table = tmp_path / "source_hashes.csv"
    commands = [[sys.executable, "-c", MANY, str(table), name] for name in "ab"]
    processes = [subprocess.Popen(command, cwd=REPOSITORY) for command in commands]
    assert [process.wait() for process in processes] == [0, 0]
    assert set(tmp_path.iterdir()) == {table, tmp_path / ".source_hashes.csv.lock"}
    rows = table.read_text(encoding="utf-8").splitlines()[1:]
    assert len(rows) == 40
    assert rows == sorted(rows)


def test_the_table_of_the_project_is_whole_and_of_known_sources():
    hashes = read_hashes(REPOSITORY / "data" / "source_hashes.csv")
    assert list(hashes) == sorted(hashes)
    assert {source_id.partition(":")[0] for source_id, _ in hashes} <= set(SOURCES)
    assert hashes["ycb:031_spoon", "google_16k/textured.mtl"].bytes == 66
