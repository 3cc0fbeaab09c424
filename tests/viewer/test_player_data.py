"""What a static player stores of an object."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from objectfolder.errors import FormatError, InputError
from pipeline.viewer.static import PAGE, SHARED_SCRIPTS, STATIC_SCRIPTS, write_player, write_player_assets


def test_a_player_is_written_and_kept_by_its_digest(small_file, tmp_path):
    first = write_player(small_file, tmp_path / "a", "bar", cache=tmp_path / "cache")
    again = write_player(small_file, tmp_path / "b", "other", cache=tmp_path / "cache")
    assert (first.baked, again.baked) == (True, False)
    assert first.size == first.script.stat().st_size < 400_000
    data = [file.script.read_text().partition(" = ")[2] for file in (first, again)]
    assert data[0] == data[1]
    assert json.loads(data[0].removesuffix(";\n"))["header"]["name"] == "Glass bar"


@pytest.mark.parametrize("name", ["", "..", "../bar", "a/b", "a\\b", "nul\0"])
def test_an_id_that_is_a_path_is_refused(small_file, tmp_path, name):
    with pytest.raises(InputError, match="no file name"):
        write_player(small_file, tmp_path / "players", name)
    assert not (tmp_path / "players").exists()


def test_damaged_files_are_named(small_file, tmp_path):
    damaged = bytearray(small_file.read_bytes())
    damaged[-100] ^= 1
    (tmp_path / "bar.safetensors").write_bytes(damaged)
    with pytest.raises(FormatError, match=r"bar\.safetensors.*digest"):
        write_player(tmp_path / "bar.safetensors", tmp_path, "bar")


def test_scripts_are_one_file_that_node_reads(tmp_path):
    write_player_assets(tmp_path)
    code = (tmp_path / "player.js").read_text()
    assert (tmp_path / "player.css").stat().st_size > 0
    for name in (*SHARED_SCRIPTS, *STATIC_SCRIPTS):
        assert (PAGE / name).read_text() in code
    if node := shutil.which("node"):
        scripts = [*map(str, sorted(Path(PAGE).glob("*.js"))), str(tmp_path / "player.js")]
        for script in scripts:
            subprocess.run([node, "--check", script], check=True)
