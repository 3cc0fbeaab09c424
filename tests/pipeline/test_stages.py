"""``dvc.yaml`` and the stages in code say the same."""

import subprocess

import pytest
import yaml
from toys import REPOSITORY

from objectfolder.provenance import code_identity
from pipeline.stages import STAGES

DVC = yaml.safe_load((REPOSITORY / "dvc.yaml").read_text())["stages"]


def outputs(stage):
    return [next(iter(out)) if isinstance(out, dict) else out for out in stage.get("outs", [])]


def source(module):
    base = REPOSITORY.joinpath(*module.split("."))
    return base / "__init__.py" if base.is_dir() else base.with_suffix(".py")


def test_stages_are_those_of_the_pipeline_in_order():
    assert list(DVC) == ["starter", *STAGES, "report"]
    for name, stage in DVC.items():
        assert stage["cmd"] == f"python -m pipeline {name}"


@pytest.mark.parametrize("name", STAGES)
def test_products_and_inputs_are_declared(name):
    stage, declared = STAGES[name], DVC[name]
    assert [out for out in outputs(declared) if out != "data/records.json"] == [
        kind.folder for kind in stage.products
    ]
    assert all(
        {"persist": True} in out.values() for out in declared["outs"] if "data/records.json" not in out
    )
    for product in stage.inputs:
        assert product.kind.folder in declared["deps"]
    if stage.inputs:
        assert "data/records.json" in declared["deps"]
    wanted = {f"sizes.${{size}}.{section.partition('.')[0]}" for section in stage.parameters}
    assert {entry for entry in declared["params"] if entry.startswith("sizes.")} == wanted


@pytest.mark.parametrize("name", STAGES)
def test_all_code_of_a_task_is_a_dependency_of_its_stage(name):
    declared = [REPOSITORY / path for path in DVC[name]["deps"]]
    for module in code_identity(STAGES[name].task.partition(":")[0]):
        path = source(module)
        assert any(path == dependency or dependency in path.parents for dependency in declared), module


@pytest.mark.parametrize("name", STAGES)
def test_packages_of_a_task_are_pinned(name):
    pinned = {line.partition("==")[0] for line in (REPOSITORY / "requirements.lock").read_text().splitlines()}
    assert {package.lower() for package in STAGES[name].packages} <= pinned


def test_lock_names_no_place_and_no_build():
    text = (REPOSITORY / "requirements.lock").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    assert all(line.count("==") == 1 for line in lines)
    assert not any(mark in line for line in lines for mark in ("+", "/", "@", " "))
    assert "torch==2.13.0" in lines


def test_make_says_what_it_can_do():
    said = subprocess.run(["make", "help"], cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout
    assert "make dataset [OBJECTS=path/to/objects.csv] [ONLY=id,id]" in said
