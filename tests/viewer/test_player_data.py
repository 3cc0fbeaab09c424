"""What a static player stores of an object."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest

import objectfolder
from objectfolder.errors import FormatError, InputError
from objectfolder.products.tensor_file import TensorFile, read_metadata, write_tensor_file
from objectfolder.vision.studio import STUDIOS
from pipeline.publish.export.base_colour import network_colour
from pipeline.publish.viewer.bake import surface_colours
from pipeline.publish.viewer.static import (
    PAGE,
    write_player,
    write_player_assets,
)


@pytest.mark.usefixtures("few_colours")
def test_a_player_is_written_and_kept_by_what_its_file_holds(small_file, tmp_path):
    script = write_player(small_file, tmp_path / "a", "bar", cache=tmp_path / "cache")
    assert script.stat().st_size < 400_000
    data = script.read_text().partition(" = ")[2].removesuffix(";\n")
    assert json.loads(data)["header"]["name"] == "Glass bar"
    (entry,) = (tmp_path / "cache").iterdir()
    entry.write_text(data.replace("Glass bar", "kept"))
    again = write_player(small_file, tmp_path / "b", "other", cache=tmp_path / "cache")
    assert '"kept"' in again.read_text(), "the Object File is not opened again"


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


@pytest.mark.usefixtures("few_colours")
def test_a_digest_that_a_file_states_opens_no_cache(small_file, tmp_path):
    """Damage leaves the stated digest as it was; a foreign file may state one that is known."""
    cache = tmp_path / "cache"
    write_player(small_file, tmp_path, "bar", cache)
    damaged = bytearray(small_file.read_bytes())
    damaged[-100] ^= 1
    stated = read_metadata(small_file)["content_digest"]
    write_tensor_file(tmp_path / "own", TensorFile({"other": np.zeros(4)}, {"format": "x"}))
    own = read_metadata(tmp_path / "own")["content_digest"]
    foreign = (tmp_path / "own").read_bytes().replace(own.encode(), stated.encode())
    for name, content in (("damaged", bytes(damaged)), ("foreign", foreign)):
        (tmp_path / name).write_bytes(content)
        assert read_metadata(tmp_path / name)["content_digest"] == stated
        with pytest.raises(FormatError, match="digest"):
            write_player(tmp_path / name, tmp_path / "players", name, cache)
    assert not (tmp_path / "players").exists()
    assert len(list(cache.iterdir())) == 1
    assert re.fullmatch(r"[0-9a-f]{64}\.\d+", next(cache.iterdir()).name)


def test_scripts_are_one_file_that_node_reads(tmp_path):
    write_player_assets(tmp_path)
    code = (tmp_path / "player.js").read_text()
    assert (tmp_path / "player.css").stat().st_size > 0
    for name in ("algebra.js", "drawing.js", "panel.js", "stored_object.js"):
        assert code.count((PAGE / name).read_text().splitlines()[0]) == 1
    if node := shutil.which("node"):
        subprocess.run([node, "--check", str(tmp_path / "player.js")], check=True)
        for script in PAGE.glob("*.js"):
            with script.open() as text:
                subprocess.run([node, "--input-type=module", "--check"], stdin=text, check=True)


def test_the_players_studios_are_the_packages():
    stated = re.search(r"const STUDIOS = (\{.*?\});", (PAGE / "drawing.js").read_text(), re.DOTALL)
    assert stated
    assert {name: tuple(map(tuple, lamps)) for name, lamps in json.loads(stated[1]).items()} == STUDIOS


def test_colours_are_those_that_the_export_gives_in_the_middle_of_faces(small_file):
    file = objectfolder.load(small_file)
    stored = surface_colours(file)
    colours = np.cumsum(stored["colours"], axis=0, dtype=np.uint8).astype(float)
    first, columns, rows = stored["grids"].T
    places = (columns + 1) * (rows + 1)
    assert len(colours) == places.sum()
    # The page's: bilinear between four places of a face.
    x, y = columns / 3, rows / 3
    i, j = np.minimum(x.astype(int), columns - 1), np.minimum(y.astype(int), rows - 1)
    at = np.cumsum(places) - places + j * (columns + 1) + i
    right, down = (x - i)[:, None], (y - j)[:, None]
    above = colours[at] * (1 - right) + colours[at + 1] * right
    under = colours[at + columns + 1] * (1 - right) + colours[at + columns + 2] * right
    face = np.arange(len(first))
    middle = np.full((len(first), 3), 1 / 3)
    metallic = file.description["material"]["metallic"]
    exported = network_colour(file.vision, file.surface, file.frame, face, middle, metallic)
    difference = np.abs(above * (1 - down) + under * down - 255 * exported[:, :3])
    # Four directions of light in place of 24, in levels of 255.
    assert np.median(difference) < 4
    assert np.ptp(255 * exported[:, :3], axis=0).max() > 40


def test_colours_of_many_faces_are_those_of_their_corners(monkeypatch, small_file):
    monkeypatch.setattr("pipeline.publish.viewer.bake.MOST_COLOURS", 10)
    assert (surface_colours(objectfolder.load(small_file))["grids"][:, 1:] == 1).all()
