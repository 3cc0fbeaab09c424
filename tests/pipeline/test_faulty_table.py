"""The stage `objects` on a table full of faults: each named, the good objects made."""

import shutil
from pathlib import Path

import pytest
from toys import REPOSITORY

from pipeline.cli import main
from pipeline.dataset.failures import read_failures
from pipeline.dataset.selection import SELECTION
from pipeline.intake.starter.die import die
from pipeline.intake.starter.write import write_obj

HEAD = "id,name,mesh,texture,material,length_m\n"
FAULTS = {
    "no_mesh": ("no_mesh,,gone/model.obj,,steel,0.1", "field mesh", "does not exist"),
    "no_texture": ("no_texture,,die/model.obj,gone.png,steel,0.1", "field texture", "does not exist"),
    "mithril": ("mithril,,die/model.obj,,mithril,0.1", "field material", "'mithril' is not known"),
    "zero": ("zero,,die/model.obj,,steel,0", "field length_m", "0 is not a length"),
    "negative": ("negative,,die/model.obj,,steel,-0.1", "field length_m", "-0.1 is not a length"),
    "millimetres": ("millimetres,,die/model.obj,,steel,90", "field length_m", "millimetres"),
    "no_number": ("no_number,,die/model.obj,,steel,big", "field length_m", "not a number"),
    "twice": ("twice,,die/model.obj,,steel,0.1\ntwice,,die/model.obj,,wood,0.2", "field id", "also used"),
    "../escape": ("../escape,,die/model.obj,,steel,0.1", "field id", "cannot be a file name"),
    "page": ("page,,page/model.obj,,steel,0.1", "model.obj", ""),
    "empty": ("empty,,empty/model.obj,,steel,0.1", "model.obj", ""),
    "nan": ("nan,,nan/model.obj,,steel,0.1", "model.obj", "not finite"),
}
MESHES = {
    "page": "<html>404: not found</html>\n",
    "empty": "# nothing\n",
    "nan": "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
}


@pytest.fixture(scope="module")
def meshes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("meshes")
    for name in ("die", *MESHES):
        (folder / name).mkdir()
    write_obj(folder / "die" / "model.obj", die())
    for name, text in MESHES.items():
        (folder / name / "model.obj").write_text(text)
    return folder


@pytest.fixture
def root(meshes: Path, tmp_path: Path) -> Path:
    shutil.copytree(meshes, tmp_path / "data")
    shutil.copy(REPOSITORY / "params.yaml", tmp_path)
    shutil.copy(REPOSITORY / "data" / "materials.csv", tmp_path / "data")
    rows = ["good,,die/model.obj,,steel,as in file", *(fault[0] for fault in FAULTS.values())]
    (tmp_path / "data" / "starter.csv").write_text(HEAD + "\n".join(rows) + "\n")
    (tmp_path / SELECTION).parent.mkdir()
    (tmp_path / SELECTION).write_text("")
    (tmp_path / "cluster").mkdir()
    (tmp_path / "cluster" / "local.yaml").write_text("kwargs: {threads_per_worker: 1}\n")
    return tmp_path


@pytest.mark.slow
def test_each_fault_is_named_and_the_others_finish(root, monkeypatch, capsys):
    monkeypatch.chdir(root)
    assert main(["stage", "objects"]) == 0
    assert [path.name for path in root.glob("data/objects/*")] == ["good.zarr.zip"]
    assert not list(root.parent.glob("escape*"))
    failures = {failure.object: failure for failure in read_failures(root)}
    assert set(failures) == set(FAULTS)
    for object_id, (_, where, finding) in FAULTS.items():
        text = failures[object_id].error
        assert where in text, text
        assert finding in text, text
        assert failures[object_id].remedy
    table = capsys.readouterr().err
    assert all(object_id in table for object_id in FAULTS)
    assert main(["failures"]) == 1
    assert str(root) not in capsys.readouterr().out


@pytest.mark.slow
def test_failures_stop_the_run_where_they_are_not_allowed(root, monkeypatch):
    monkeypatch.chdir(root)
    parameters = root / "params.yaml"
    parameters.write_text(parameters.read_text().replace("allow_failures: true", "allow_failures: false"))
    assert main(["stage", "objects"]) == 1
    assert (root / "data/objects/good.zarr.zip").exists()


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("params.yaml", "seed: 0", "sead: 0", "params.yaml: unknown key sead. Did you mean seed?"),
        ("data/starter.csv", "material", "stuff", "has no column 'material'"),
        ("data/selection/only.txt", "", "godo", "there is no object 'godo'. Did you mean 'good'?"),
        ("cluster/local.yaml", "kwargs", "kwrags", "unknown key kwrags"),
        ("data/materials.csv", "density_kg_m3", "density", "column density_kg_m3 is missing"),
    ],
)
@pytest.mark.usefixtures("quiet")
def test_faults_of_the_whole_are_one_line(root, file, old, new, message, monkeypatch, capsys):
    path = root / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    monkeypatch.chdir(root)
    assert main(["stage", "objects"]) == 1
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (root / "data/objects").exists()
