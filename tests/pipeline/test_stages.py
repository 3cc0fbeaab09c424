"""``dvc.yaml`` and the stages in code say the same."""

import json
import subprocess

import pytest
import yaml
from toys import REPOSITORY

from objectfolder.making.materials import read_materials
from objectfolder.products.provenance import fingerprint
from objectfolder.products.store import Product, write_product
from objectfolder.products.tensor_file import TensorFile, write_tensor_file
from pipeline.cli.declare import declared
from pipeline.dataset.catalogue import ObjectRecord
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.records import row_of
from pipeline.dataset.stages import MODES, STAGES
from pipeline.dataset.verified import Verified
from pipeline.run.code_digests import CODE, REPORT, write_code_digests

DVC = yaml.safe_load((REPOSITORY / "dvc.yaml").read_text())["stages"]


def test_stages_are_those_of_the_pipeline_in_order():
    assert list(DVC) == ["code", "starter", "inputs", "products", *STAGES, "report", "failures"]
    for name in DVC.keys() - STAGES.keys() - {"failures"}:
        assert DVC[name]["cmd"] == f"exec python -m pipeline.cli {name}"


def test_dvc_yaml_has_what_the_stages_declare():
    stale = [
        f"{name}: {section}"
        for name, sections in declared().items()
        for section, said in sections.items()
        if DVC[name][section] != said
    ]
    assert not stale, f"run `make stages`: {stale}"


def test_every_stage_but_the_first_has_a_dependency_and_none_always_changes():
    assert DVC["code"]["deps"] == ["objectfolder", "pipeline", "requirements.lock"]
    assert all(stage.get("deps") or stage["params"] for stage in DVC.values())
    assert not any("always_changed" in stage for stage in DVC.values())


@pytest.mark.slow
def test_all_code_of_a_stage_has_a_digest(tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    (tmp_path / "params.yaml").symlink_to(REPOSITORY / "params.yaml")
    write_code_digests(tmp_path)
    digests = json.loads((tmp_path / CODE).read_text())
    named = [name for stage in DVC.values() for file in stage.get("params", ()) if str(CODE) in file
             for name in file[str(CODE)]]  # fmt: skip
    assert sorted(named) == sorted(digests)
    (tmp_path / "index.html.j2").write_text("another page")
    monkeypatch.setattr("pipeline.run.code_digests.PAGES", tmp_path)
    write_code_digests(tmp_path)
    another = json.loads((tmp_path / CODE).read_text())
    assert [name for name in digests if another[name] != digests[name]] == [REPORT]


def pins(path):
    """Lines of a lock without its head."""
    return {line for line in path.read_text().splitlines() if not line.startswith("#")}


@pytest.mark.parametrize("name", STAGES)
def test_packages_of_a_task_are_pinned(name):
    pinned = {line.partition("==")[0] for line in pins(REPOSITORY / "requirements.lock")}
    assert {package.lower() for package in STAGES[name].packages} <= pinned


LOCKS = {path.name: pins(path) for path in sorted(REPOSITORY.glob("requirements*.lock"))}


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_has_all_of_making_and_names_no_place_and_no_build(name):
    lines = LOCKS[name]
    assert all(line.count("==") == 1 for line in lines)
    assert not any(mark in line for line in lines for mark in ("+", "/", "@", " "))
    assert "torch==2.13.0" in lines
    assert LOCKS["requirements.lock"] <= lines <= LOCKS["requirements-test.lock"]


def test_making_installs_nothing_of_tests_and_clusters():
    lock = {line.partition("==")[0] for line in LOCKS["requirements.lock"]}
    assert not lock & {
        "playwright",
        "pybullet",
        "tensorboard",
        "moto",
        "kubernetes",
        "mujoco",
        "intel-openmp",
    }


def test_make_says_what_it_can_do():
    said = subprocess.run(["make", "help"], cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout
    assert "make dataset [OBJECTS=path/to/objects.csv] [ONLY=id,id]" in said


MATERIALS = read_materials(REPOSITORY / "data" / "materials.csv")


def products_of_a_former_run(root):
    """Products of every kind, with the attributes that later stages go by."""
    for stage in STAGES.values():
        for path in stage.targets(root, "mug"):
            attributes = {"fingerprint": f"{path.parent.name} made first"}
            if path.name.endswith(".safetensors"):
                write_tensor_file(path, TensorFile({}, attributes))
            else:
                more = {
                    "digests": {"geometry": "g", "texture": "t", "normals": "n", "body": "b"},
                    "sensor": {"pixels": 1},
                    "contact": "rigid",
                }
                write_product(path, Product({}, {**attributes, **more}))


@pytest.fixture(scope="module")
def verified(tmp_path_factory):
    """What is known of files and of the code, which takes a second to read."""
    return Verified(tmp_path_factory.mktemp("verified"))


def wanted(root, verified, **changes):
    """Fingerprint of every stage for a steel mug with `changes` to its record."""
    mesh = root / "mug.obj"
    mesh.write_text("v 0 0 0\n")
    described = {
        "id": "mug", "name": "Mug", "mesh": mesh, "texture": None, "material": "steel", "length_m": None,
        "source": "", "licence": "CC0", "attribution": "", **changes,
    }  # fmt: skip
    record = ObjectRecord(**described)
    row = row_of(record, MATERIALS[record.material])
    parameters = read_parameters(REPOSITORY / "params.yaml")
    return {
        name: fingerprint(stage.prepare(root, parameters, "mug", row, verified).parts)
        for name, stage in STAGES.items()
    }


@pytest.mark.parametrize(
    ("change", "stages"),
    [
        ({"material": "iron"}, {"modes", "fidelity"}),  # looks as steel does
        ({"material": "wood"}, {"views", "modes", "fidelity"}),
        ({"roughness": 0.9}, {"views"}),
        ({"name": "Cup"}, {"fidelity"}),
        ({"licence": "CC BY 4.0"}, {"fidelity"}),
        ({"length_m": 0.1}, {"objects"}),
        ({"wall_m": 0.002}, {"modes"}),
        ({"shell_m": 0.002}, {"modes"}),
    ],
)
def test_a_change_concerns_the_stages_that_read_it(tmp_path, verified, change, stages):
    products_of_a_former_run(tmp_path)
    before, after = wanted(tmp_path, verified), wanted(tmp_path, verified, **change)
    assert {name for name in STAGES if before[name] != after[name]} == stages


def test_new_modes_are_encoded_and_verified_and_nothing_else(tmp_path, verified):
    products_of_a_former_run(tmp_path)
    before = wanted(tmp_path, verified)
    write_product(MODES.path(tmp_path, "mug"), Product({}, {"fingerprint": "made again"}))
    after = wanted(tmp_path, verified)
    assert {name for name in STAGES if before[name] != after[name]} == {"encode", "fidelity"}
