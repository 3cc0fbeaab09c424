"""What is declared of products on other machines, on real tasks; and that a changed value is found."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from toys import REPOSITORY

from objectfolder.errors import FormatError
from objectfolder.making.materials import read_materials
from objectfolder.products.provenance import canonical_json
from objectfolder.products.store import Array, Product, write_product
from objectfolder.products.tensor_file import TensorFile, read_tensor_file, write_tensor_file
from objectfolder.touch.sensor.sensor import Sensor
from pipeline.audit.reproducibility import DIFFERENT, EQUAL, WITHIN, compare
from pipeline.dataset.records import row_of
from pipeline.dataset.stages import STAGES
from pipeline.dataset.tolerances import TOLERANCES, as_json

# As a processor without wide vectors would have it; where these mean nothing, nothing is changed.
OTHER = {
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL",
    "OPENBLAS_CORETYPE": "Nehalem",
    "MKL_CBWR": "COMPATIBLE",
    "ATEN_CPU_CAPABILITY": "default",
    "TZ": "Pacific/Auckland",
    "LC_ALL": "C",
}
MODULE = """
import json, sys
from pathlib import Path
from pipeline.sandbox.child import execute
from pipeline.dataset.task import Call, Request
for stage, task, targets, inputs, parameters, record in json.loads(sys.argv[1]):
    request = Request("bar", {name: Path(path) for name, path in inputs.items()}, parameters, record, 7)
    outcome = execute(Call(stage, task, request, tuple(map(Path, targets)), "f" * 64, {}))
    if outcome.failure:
        sys.exit(f"{outcome.failure.error} {outcome.failure.detail}")
"""


def run(folder: Path, stages: dict[str, dict[str, object]], mesh: Path, **environment: str) -> Path:
    """Make products of a bar by the real tasks, in a process of its own."""
    calls = []
    for name, settings in stages.items():
        stage = STAGES[name]
        inputs = {product.kind.name: str(product.kind.path(folder, "bar")) for product in stage.inputs}
        targets = [str(path) for path in stage.targets(folder, "bar")]
        sources = {} if stage.inputs else {"mesh": str(mesh)}
        record = settings.get("record", {})
        calls.append(
            [name, stage.task, targets, {**inputs, **sources}, settings.get("parameters", {}), record]
        )
    done = subprocess.run(
        [sys.executable, "-c", MODULE, json.dumps(calls)],
        cwd=REPOSITORY,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def bar(tmp_path: Path) -> Path:
    path = tmp_path / "model.obj"
    trimesh.creation.box((0.12, 0.03, 0.008)).subdivide_to_size(0.02).export(path)
    return path


@pytest.fixture
def stages(bar: Path) -> dict[str, dict[str, object]]:
    """Record and parameters of the stages that are made."""
    material = read_materials(REPOSITORY / "data" / "materials.csv")["steel"]
    described = SimpleNamespace(
        mesh=bar, texture=None, senses=("vision", "audio", "touch"),
        **dict.fromkeys(("name", "source", "licence", "attribution"), ""),
        **dict.fromkeys(("length_m", "up", "roughness", "metallic", "wall_m", "shell_m", "mass_kg")),
        glass="opaque",
    )  # fmt: skip
    row = row_of(described, material)
    touch = {
        "sensor": Sensor().to_dict(), "contact": "rigid", "touches": 2, "held_out_touches": 2,
        "depth_m": [0.0005, 0.002], "tilt_deg": 0.0, "at_vertices": False,
    }  # fmt: skip
    audio = {
        "max_frequency_hz": 4000.0, "max_modes": 8, "accuracy_cents": 50.0,
        "training_points": 60, "held_out_points": 10,
    }  # fmt: skip
    vision = {
        "resolution": 16, "field_of_view_deg": 39.6, "camera_radius": 2.5, "training_views": 2,
        "training_samples": 2, "held_out_views": 1, "held_out_samples": 4, "light_power_w": 12.0,
        "passes": True,
    }  # fmt: skip
    heard = {name: row[name] for name in ("material", "walls", "senses")}
    return {
        "objects": {"record": {"length_m": None, "file_names": ["model.obj", None]}},
        "touches": {"parameters": {"touch": touch}},
        "modes": {"record": heard, "parameters": {"audio": audio}},
        "views": {"record": {"appearance": row["appearance"]}, "parameters": {"vision": vision}},
    }


def verdicts(first: Path, second: Path, stages: object) -> dict[str, str]:
    """Verdict of every array and attribute of all stages."""
    return {
        f"{name}/{finding.name}": finding.verdict
        for name in stages
        for first_path, second_path in zip(
            STAGES[name].targets(first, "bar"), STAGES[name].targets(second, "bar"), strict=True
        )
        for finding in compare(first_path, second_path, STAGES[name].tolerances)
    }


@pytest.mark.release("objectfolder", "pipeline.tasks")
def test_products_are_as_declared_on_another_processor(tmp_path, stages, bar):
    usual = run(tmp_path / "usual", stages, bar)
    other_processor = run(tmp_path / "other", stages, bar, **OTHER)
    verdict_by_name = verdicts(usual, other_processor, stages)
    assert {
        "objects/vertices", "touches/rgb", "touches/attributes/contact", "modes/frequencies_hz"
    } <= set(verdict_by_name)  # fmt: skip
    assert [name for name, verdict in verdict_by_name.items() if verdict == DIFFERENT] == []
    # Of geometry and touch, nothing else may differ at all.
    declared_apart = {f"touches/{name}" for name in TOLERANCES["touches"]}
    exact = {name for name in verdict_by_name if name.startswith(("objects/", "touches/"))} - declared_apart
    assert {name for name in exact if verdict_by_name[name] != EQUAL} == set()


def written(path: Path, name: str, values: np.ndarray, units: str = "1") -> Path:
    """A product of one array."""
    array = Array(values, tuple(f"axis_{axis}" for axis in range(values.ndim)), units, name)
    write_product(path, Product({name: array}))
    return path


def only(first: Path, second: Path, stage: str, name: str):
    """The finding for one array; all others are equal."""
    entries = {entry.name: entry for entry in compare(first, second, TOLERANCES[stage])}
    assert {entry.verdict for entry in entries.values() if entry.name != name} <= {EQUAL}
    return entries[name]


@pytest.mark.parametrize(("value", "other"), [(1.0, np.nextafter(1.0, 2.0)), (0.0, -0.0)])
def test_one_ulp_or_the_sign_of_zero_is_found_in_an_array_of_the_same_bytes(tmp_path, value, other):
    first, second = (
        written(tmp_path / f"{name}.zarr.zip", "vertices", np.array([[3.0, last]]))
        for name, last in (("a", value), ("b", other))
    )
    finding = only(first, second, "objects", "vertices")
    assert (finding.verdict, finding.largest) == (DIFFERENT, abs(other - value))
    assert finding.relative < 1e-15


@pytest.mark.parametrize(("share", "verdict"), [(0.5, WITHIN), (2.0, DIFFERENT)])
def test_a_tolerance_ends_where_it_is_declared(tmp_path, share, verdict):
    areas = np.array([1e-5, 3e-5, 2e-5])
    first = written(tmp_path / "a.zarr.zip", "contact_area_m2", areas, "m2")
    shifted = areas + share * TOLERANCES["touches"]["contact_area_m2"].relative * np.ptp(areas) * np.eye(3)[2]
    second = written(tmp_path / "b.zarr.zip", "contact_area_m2", shifted, "m2")
    assert only(first, second, "touches", "contact_area_m2").verdict == verdict


@pytest.mark.parametrize(
    "other",
    [np.ones(3), np.ones(4, np.float32), np.array([1, 1, 1, np.nan]), np.array([1, 1, 1, np.inf])],
)
def test_another_shape_type_or_place_of_nan_is_different_whatever_is_allowed(tmp_path, other):
    first, second = (
        written(tmp_path / f"{name}.zarr.zip", "frequencies_hz", values, "Hz")
        for name, values in (("a", np.ones(4)), ("b", other))
    )
    finding = only(first, second, "modes", "frequencies_hz")
    assert (finding.verdict, finding.largest) == (DIFFERENT, np.inf)


def test_an_array_or_attribute_of_one_product_alone_is_different(tmp_path):
    array = Array(np.ones(4), ("x",), "Hz", "x")
    write_product(tmp_path / "a.zarr.zip", Product({"x": array}, {"said": {"of": [1.0]}, "fingerprint": "a"}))
    write_product(tmp_path / "b.zarr.zip", Product({"y": array}, {"said": {"of": ["1"]}, "fingerprint": "b"}))
    verdict_by_name = {entry.name: entry.verdict for entry in compare(*sorted(tmp_path.iterdir()), {})}
    assert verdict_by_name == dict.fromkeys(
        ("x", "y", "attributes/said/of", "attributes/said/of/0"), DIFFERENT
    )


def test_tensor_files_are_compared_with_their_metadata(tmp_path):
    content = TensorFile({"vision.a": np.linspace(0, 1, 9, dtype=np.float16)}, {"said": {"x": 1.5}})
    moved = content.tensors["vision.a"].copy()
    moved[3] = np.nextafter(moved[3], np.float16(9))
    write_tensor_file(tmp_path / "a.safetensors", content)
    write_tensor_file(tmp_path / "b.safetensors", TensorFile({"vision.a": moved}, {"said": {"x": 1.6}}))
    paths = sorted(tmp_path.iterdir())
    verdict_by_name = {entry.name: entry.verdict for entry in compare(*paths, TOLERANCES["encode"])}
    assert verdict_by_name == {"vision.a": WITHIN, "attributes/said/x": DIFFERENT}
    paths[1].write_bytes(paths[1].read_bytes()[:-1])
    with pytest.raises(FormatError):
        compare(*paths, TOLERANCES["encode"])
    assert read_tensor_file(paths[0]).tensors


def test_what_stages_declare_is_json():
    for stage in STAGES.values():
        said = as_json(stage.tolerances)
        assert json.loads(canonical_json(said)) == said
