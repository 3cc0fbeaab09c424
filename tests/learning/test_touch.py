"""Touch of meshes without views and modes."""

import numpy as np
import pytest
import trimesh

from learning import encoders, runs, touch
from learning.meshes import Meshes
from learning.settings import Sides
from learning.workers import Here
from objectfolder import example
from objectfolder.errors import InputError

SHAPES = {
    "ball": trimesh.creation.icosphere(3, 0.03),
    "can": trimesh.creation.cylinder(0.03, 0.08, sections=64).subdivide().subdivide(),
    "cube": trimesh.creation.box((0.05, 0.05, 0.05)).subdivide().subdivide().subdivide().subdivide(),
    "ring": trimesh.creation.torus(0.03, 0.008),
}


@pytest.fixture
def folder(tmp_path):
    for name, mesh in SHAPES.items():
        (tmp_path / "meshes" / name).mkdir(parents=True)
        mesh.export(tmp_path / "meshes" / name / "model.obj")
    return tmp_path / "meshes"


def test_a_mesh_is_touched_as_its_object_file(tmp_path):
    mug = example("mug")
    for name in "abcd":
        (tmp_path / name).mkdir()
        trimesh.Trimesh(mug.surface.vertices, mug.surface.faces, process=False).export(
            tmp_path / name / "model.obj"
        )
    mesh = Meshes(tmp_path, "digit").files["a"]
    points, _ = mug.sample_contacts(8)
    of_mesh, of_file = (source.press(points, 1e-3).rgb.astype(float) for source in (mesh, mug))
    contrast = of_file.std(axis=0).mean()
    assert np.sqrt(np.square(of_mesh - of_file).mean()) < 0.1 * contrast


@pytest.mark.release("learning")
def test_shapes_are_told_by_touch_and_draws_are_kept(folder, tiny, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(runs, "RUNS", tmp_path / "runs")
    monkeypatch.setattr(encoders, "LOGS", tmp_path / "logs")
    at_vertices = tiny.touch_at_vertices.model_copy(update={"training": 80, "epochs": 5, "batch": 16})
    data = tiny.data.model_copy(update={"resolution": Sides(vision=16, audio=16, touch=24)})
    settings = tiny.model_copy(update={"touch_at_vertices": at_vertices, "data": data})
    result = touch.evaluate(Meshes(folder, "digit-tacto"), settings, Here())
    assert result["vertex"]["training_touches"] == [80, 80]
    assert result["vertex"]["T"]["accuracy_percent"] > 50
    several = result["vertex"]["several"]
    assert several["1"]["accuracy_percent"] <= several["5"]["accuracy_percent"]
    assert result["vertex region"]["nearest_training_place"] > result["vertex"]["nearest_training_place"]
    assert capsys.readouterr().out.count("touches: object") == len(SHAPES)


@pytest.mark.slow
def test_meshes_that_cannot_be_touched_are_left_out(folder, tiny, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(runs, "RUNS", tmp_path / "runs")
    settings = tiny.model_copy(
        update={
            "data": tiny.data.model_copy(update={"test": 20}),
            "touch_at_vertices": tiny.touch_at_vertices.model_copy(update={"training": 200}),
        }
    )
    coarse = {"corners": trimesh.creation.box((0.05, 0.05, 0.05))}
    coarse["die"] = coarse["corners"].subdivide()  # 26 vertices, of which no fifth of the regions has 20
    for name, mesh in coarse.items():
        (folder / name).mkdir()
        mesh.export(folder / name / "model.obj")
    (folder / "empty").mkdir()
    (folder / "empty" / "model.obj").write_text("v 0 0 0\n", encoding="utf-8")
    meshes, left_out = touch.touchable(Meshes(folder, "digit-tacto"), settings, Here())
    assert meshes.ids == tuple(SHAPES)
    assert meshes.digests.keys() == meshes.files.keys() == SHAPES.keys()
    assert left_out.keys() == {"corners", "die", "empty"}
    assert left_out["corners"] == "8 vertices can be pressed, 25 are needed"
    assert left_out["die"].endswith(
        "of 26 vertices lie in held-out regions: 20 there and 5 elsewhere are needed"
    )
    printed = capsys.readouterr().out
    assert all(f"left out: {name}: {finding}" in printed for name, finding in left_out.items())
    with pytest.raises(InputError, match=r"3 meshes that can be touched, fewer than 4"):
        meshes.without(["ball"])


def test_a_folder_without_meshes_is_an_error(tmp_path):
    with pytest.raises(InputError, match=r"0 folders with a model\.obj, fewer than 4"):
        Meshes(tmp_path, "digit")
