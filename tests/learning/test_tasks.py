"""The tasks from end to end, very small, and their parameters."""

import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from learning import encoders, occupancy, recognition, reconstruction, retrieval, runs
from learning.__main__ import TASKS, main
from learning.page import settings_path, write_page
from learning.runs import Objects, kept, kept_path
from learning.settings import read_settings
from learning.workers import Here
from objectfolder.errors import InputError
from objectfolder.products.provenance import code_identity

REPOSITORY = Path(__file__).parents[2]
PARAMETERS = REPOSITORY / "learning" / "params.yaml"


def test_parameters_are_read_strictly(tmp_path):
    text = PARAMETERS.read_text(encoding="utf-8")
    path = tmp_path / "params.yaml"
    path.write_text(text.replace("margin:", "margn:"), encoding="utf-8")
    with pytest.raises(InputError, match=r"retrieval\.margin: field required"):
        read_settings(path)
    path.write_text(text.replace("regions: 10", "regions: 2"), encoding="utf-8")
    with pytest.raises(InputError, match=r"data\.regions: .*greater than or equal to 5"):
        read_settings(path)


def test_what_was_made_is_not_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "RUNS", tmp_path)
    calls = []

    def compute():
        calls.append(1)
        return {"value": np.arange(3)}

    for key in ({"unit": "a"}, {"unit": "a"}, {"unit": "b"}):
        assert kept("learning.metrics", key, compute)["value"].tolist() == [0, 1, 2]
    assert len(calls) == 2
    assert not list(tmp_path.glob("*.partial"))


@pytest.mark.slow
def test_what_other_code_made_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "RUNS", tmp_path)
    paths = {kept_path(module, {"unit": "a"}, ".npz") for module in ("learning.metrics", "learning.encoders")}
    assert len(paths) == 2
    # What draws the samples is the library's code: another renderer makes other features.
    reached = code_identity("learning.encoders")
    assert {"objectfolder.object_file", "learning.samples", "learning.networks"} <= reached.keys()
    assert not [module for module in reached if module.startswith("pipeline.")]


def test_dvc_knows_the_code_and_the_parameters_of_every_task():
    stages = yaml.safe_load((REPOSITORY / "learning" / "dvc.yaml").read_text(encoding="utf-8"))["stages"]
    modules = (path.relative_to(REPOSITORY).as_posix() for path in (REPOSITORY / "learning").glob("*.py"))
    assert set(stages["code"]["deps"]) == {*modules, "learning/grasping", "objectfolder"}
    sections = set(yaml.safe_load(PARAMETERS.read_text(encoding="utf-8")))
    declared = {}
    for task in TASKS:
        (code,), parameters = (next(iter(part.values())) for part in stages[task]["params"])
        assert code == task
        declared[task] = set(parameters)
    assert set().union(*declared.values()) == sections
    assert "regrasping" not in declared["recognition"] | declared["grasping"]


def test_settings_are_no_metrics():
    stages = yaml.safe_load((REPOSITORY / "learning" / "dvc.yaml").read_text(encoding="utf-8"))["stages"]
    for task in TASKS:
        (metrics,), (outs,) = stages[task]["metrics"], stages[task]["outs"]
        assert list(metrics) == [f"learning/results/{task}.json"]
        assert list(outs) == [f"learning/results/settings/{task}.json"]


def test_a_task_hangs_on_the_code_of_the_tasks_that_it_uses():
    for task in ("retrieval", "reconstruction", "stand_in"):
        assert "learning.recognition" in code_identity(TASKS[task].__module__)


def test_shapes_are_kept_by_their_own_parameters(monkeypatch):
    monkeypatch.setattr(reconstruction, "kept", lambda module, key, compute: {"key": json.dumps(key)})

    def key_of(settings, unseen=()):
        objects = SimpleNamespace(digests={"mug": "0"})
        return reconstruction.Trial(
            objects, settings, None, ("vision",), (0, 1), (0, 1), unseen, 0
        ).predictions["key"]

    settings, small = read_settings(PARAMETERS), read_settings(PARAMETERS.with_name("small.yaml"))
    sections = ("touch_at_vertices", "retrieval", "stand_in", "grasping", "regrasping")
    assert key_of(settings) == key_of(
        settings.model_copy(update={name: getattr(small, name) for name in sections})
    )
    wider = settings.encoder.model_copy(update={"width": 24})
    own = ({"data": small.data}, {"encoder": wider}, {"reconstruction": small.reconstruction})
    assert len({key_of(settings.model_copy(update=update)) for update in ({}, *own)}) == 1 + len(own)
    # Networks of unseen objects share the draws of the first seed.
    reseeded = settings.model_copy(update={"seeds": (7,)})
    assert key_of(settings) == key_of(reseeded)
    assert key_of(settings, (1,)) != key_of(reseeded, (1,))


@pytest.mark.release("learning", "objectfolder")
def test_tasks_of_four_twins_end_in_a_page(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "RUNS", tmp_path)
    monkeypatch.setattr(encoders, "LOGS", tmp_path / "logs")
    monkeypatch.setattr(occupancy, "FAR_POINTS", 20_000)
    monkeypatch.setattr(occupancy, "NEAR_POINTS", 9000)
    objects = Objects(tiny)
    accuracies = recognition.evaluate(objects, tiny, Here())
    assert accuracies["chance_percent"] == 25
    for senses in ("V", "A", "T", "VAT"):
        low, high = accuracies["sample"][senses]["interval_percent"]
        assert low <= 25 <= high
    for row in accuracies["region"]["confusions"].values():
        assert all(pair["object"] != pair["named"] and pair["tests"] > 0 for pair in row)
    assert (
        accuracies["sample"]["T"]["worst"]["accuracy_percent"]
        <= accuracies["sample"]["T"]["accuracy_percent"]
    )
    for ways in accuracies["pretrained"].values():
        joined = {"with_own", "with_own_and_neighbours", "with_own_and_touch"}
        assert set(ways) == {"pretrained", *joined}
        for figures in ways.values():
            low, high = figures["interval_percent"]
            assert low <= 25 <= high
    retrieved = retrieval.evaluate(objects, tiny, Here())
    directions = {"V to A", "A to V", "V to T", "T to V", "A to T", "T to A"}
    assert set(retrieved["seen"]) == directions
    assert retrieved["unseen"] == retrieved["end_to_end"] == {}, "all twins are unseen together"
    assert set(retrieved["at_vertices"]) == {name for name in directions if "T" in name}
    for methods in [*retrieved["seen"].values(), *retrieved["at_vertices"].values()]:
        for score in methods.values():
            assert abs(score["map"] - score["chance"]) < 0.2
    shaped = reconstruction.evaluate(objects, tiny, Here())
    # The mesh of a twin is the object's own: looking it up cannot be told from the measure's floor.
    assert shaped["seen"]["V"]["look_up"]["iou"] == pytest.approx(shaped["floor"]["iou"])
    assert shaped["average_of_others"]["iou"] == 1
    for name, figures in (("recognition", accuracies), ("retrieval", retrieved), ("reconstruction", shaped)):
        for path, content in (
            (tmp_path / f"{name}.json", figures),
            (settings_path(tmp_path / f"{name}.json"), {"settings": tiny.model_dump()}),
        ):
            path.parent.mkdir(exist_ok=True)
            path.write_text(json.dumps(content), encoding="utf-8")
    (tmp_path / "metaworld.json").write_text("[]", encoding="utf-8")
    write_page(objects, tiny, tmp_path, tmp_path / "reports" / "learning.html")
    text = (tmp_path / "reports" / "learning.html").read_text(encoding="utf-8")
    headings = re.findall(r"<h2>(.*?)</h2>", text)
    assert headings == ["Which object is it?", "Find the object by another sense", "What shape is it?"]
    assert re.search(r"chance\s25\.0\.", text)
    assert text.count("audio controls") >= 3
    assert not re.search(r'(?:src|href)="(?!data:|index\.html)', text), "the page stands alone"
    assert "Images of 20 pixels gain" in text
    del accuracies["vertex"]["finer"]  # as with `finer_resolution: null`
    (tmp_path / "recognition.json").write_text(json.dumps(accuracies), encoding="utf-8")
    write_page(objects, tiny, tmp_path, tmp_path / "reports" / "learning.html")
    assert "pixels gain" not in (tmp_path / "reports" / "learning.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_figures_stand_beside_the_settings_and_the_objects_that_they_are_of(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr("learning.__main__.read_settings", lambda path: tiny)
    monkeypatch.setitem(TASKS, "retrieval", lambda objects, settings, workers: {"objects": len(objects)})
    monkeypatch.setattr(sys, "argv", ["learning", "retrieval", "--results", str(tmp_path)])
    main()
    figures = tmp_path / "retrieval.json"
    assert json.loads(figures.read_text()) == {"objects": 4}
    stated = json.loads(settings_path(figures).read_text())
    assert stated == {"objects": ["a", "b", "c", "d"], "settings": json.loads(json.dumps(tiny.model_dump()))}


def test_too_few_objects_are_an_error(small_file, tiny, tmp_path):
    (tmp_path / "data" / "object_files").mkdir(parents=True)
    (tmp_path / "data" / "object_files" / "bar.safetensors").symlink_to(small_file)
    alone = tiny.model_copy(update={"data": tiny.data.model_copy(update={"root": str(tmp_path)})})
    with pytest.raises(InputError, match="1 objects with a sound, fewer than 4"):
        Objects(alone)
    named = alone.model_copy(update={"data": alone.data.model_copy(update={"objects": ("cup",)})})
    with pytest.raises(InputError, match="no object 'cup'"):
        Objects(named)
