"""An object that no solid comes of is seen and felt, and its sound says why it is not there."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import objectfolder
from objectfolder.errors import InputError, QueryError, UnsolvableError
from objectfolder.fidelity.sound import measure_sound
from objectfolder.making.audionet.fitting import fit_audionet
from objectfolder.making.materials import read_materials
from objectfolder.making.mesh.body import body_of
from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.making.modes.absent import LEFT_OUT, absent_modes
from objectfolder.making.solid.solid import Solid
from objectfolder.object_file import ObjectFile
from objectfolder.products.store import Product, read_attributes, write_product
from objectfolder.surface.codec import encode_surface
from pipeline.dataset.catalogue import read_catalogue
from pipeline.dataset.task import Request
from pipeline.publish.queries.description import info_lines
from pipeline.tasks.modes import compute_modes

ROOT = Path(__file__).parents[1]
REASON = "no solid came of filling it"


def _modes(folder: Path, senses: list[str]) -> Product:
    """The task of stage `modes` for a sheet of one square, which has no inside."""
    (folder / "sheet.obj").write_text("v 0 0 0\nv .1 0 0\nv .1 .1 0\nv 0 .1 0\nf 1 2 3 4\n")
    inputs = {"objects": folder / "objects.zarr.zip"}
    write_product(inputs["objects"], ingest_object(folder / "sheet.obj", object_id="sheet"))
    steel = asdict(read_materials(ROOT / "data/materials.csv")["steel"])
    material = {key: steel[key] for key in steel if key not in ("roughness", "metallic", "citation")}
    record = {"material": material, "walls": {"wall_m": None, "shell_m": None}, "senses": senses}
    audio = {"training_points": 10, "held_out_points": 2, "max_frequency_hz": 2000.0}
    return compute_modes(Request("sheet", inputs, {"audio": audio}, record, 0))


def test_an_object_that_cannot_be_filled_has_modes_that_say_why_there_are_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> Solid:  # as `fill` does a sheet, after trying what takes long
        raise UnsolvableError("sheet", REASON, "State wall_m")

    monkeypatch.setattr("objectfolder.making.modes.modes.fill", refuse)
    modes = _modes(tmp_path, ["vision", "audio", "touch"])
    assert modes.attributes["absent"] == f"{REASON}. State wall_m"
    assert REASON in modes.attributes["warnings"][0]
    assert not modes.attributes["audible"]
    assert modes["mode_shapes"].shape == (0, 3, 0)


def test_sound_left_out_by_the_table_is_not_tried(tmp_path: Path) -> None:
    assert _modes(tmp_path, ["vision", "touch"]).attributes["absent"] == "left out by choice (column senses)"


@pytest.fixture(scope="module")
def seen_and_felt(small_file: Path, tmp_path_factory: pytest.TempPathFactory) -> ObjectFile:
    bar = objectfolder.load(small_file)
    folder = tmp_path_factory.mktemp("absent")
    _modes(folder, ["vision", "touch"])
    body = body_of(read_attributes(folder / "objects.zarr.zip"), 7850.0, absent_modes(LEFT_OUT).attributes)
    silent = fit_audionet(bar.surface, absent_modes(REASON))
    described = {**bar.description, "body": body}
    file = bar.of_encoders(
        encode_surface(bar.surface), bar.frame, bar.vision, silent, bar.touch.net, described
    )
    path = folder / "bar.safetensors"
    file.save(path)
    return objectfolder.load(path)


def test_an_object_without_sound_is_seen_and_felt(seen_and_felt: ObjectFile, small_file: Path) -> None:
    bar = objectfolder.load(small_file)
    view = seen_and_felt.sample_views(1, seed=0)
    np.testing.assert_array_equal(
        seen_and_felt.render(*view, resolution=16), bar.render(*view, resolution=16)
    )
    points, _ = bar.sample_contacts(2, seed=0, reachable=False)
    np.testing.assert_array_equal(seen_and_felt.press(points).rgb, bar.press(points).rgb)
    assert "no sound" in seen_and_felt._repr_html_()
    assert "sound        no sound" in info_lines(seen_and_felt, small_file)


def test_every_query_of_its_sound_says_why_there_is_none(seen_and_felt: ObjectFile) -> None:
    points, normals = seen_and_felt.sample_contacts(2, seed=0, reachable=False)
    queries = {
        "strike": lambda: seen_and_felt.strike(points, -normals, 0.1),
        "strikes": lambda: list(seen_and_felt.strikes(points, -normals, 0.1)),
        "rms_velocity": lambda: seen_and_felt.rms_velocity(points, -normals, np.zeros(1)),
        "mode_velocities": lambda: seen_and_felt.mode_velocities(points, -normals),
        "stream": lambda: seen_and_felt.stream(),
    }
    for query in queries.values():
        with pytest.raises(QueryError, match=f"the object has no sound: {REASON}"):
            query()


def test_its_fidelity_says_why_there_is_no_sound(seen_and_felt: ObjectFile) -> None:
    measured = measure_sound(seen_and_felt, absent_modes(REASON))
    assert measured["absent"] == REASON
    assert measured["gain_error_db"] is None
    assert measured["modes"] == 0


def test_the_body_of_an_object_without_a_solid_has_no_filled_mass(tmp_path: Path) -> None:
    _modes(tmp_path, ["vision", "touch"])
    body = body_of(read_attributes(tmp_path / "objects.zarr.zip"), 7850.0, absent_modes(LEFT_OUT).attributes)
    assert body["filled_mass_kg"] is None
    assert body["mass_kg"] is None


def test_the_table_leaves_sound_out_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "bar.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    stated = {"all": "", "seen": "touch Vision", "heard": "audio", "odd": "smell"}
    rows = "".join(f"{object_id},bar.obj,steel,{senses}\n" for object_id, senses in stated.items())
    (tmp_path / "objects.csv").write_text(f"id,mesh,material,senses\n{rows}")
    catalogue = read_catalogue(tmp_path / "objects.csv", ["steel"])
    assert {record.id: record.senses for record in catalogue.records} == {
        "all": ("vision", "audio", "touch"),
        "seen": ("vision", "touch"),
    }
    assert set(catalogue.errors) == {"heard", "odd"}
    assert isinstance(catalogue.errors["odd"], InputError)
    assert "field senses" in str(catalogue.errors["odd"])
