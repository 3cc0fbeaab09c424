"""What tasks are expected to take: own runs first, then others of the stage, then the packaged costs."""

import csv
import math
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from objectfolder.products.store import Product, write_product
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.stages import MODES, OBJECTS, STAGES
from pipeline.dataset.task import Outcome
from pipeline.run.costs import COLUMNS, add_costs, costs_path
from pipeline.run.forecast import machine
from pipeline.run.forecast.estimates import (
    HIGH_QUANTILE,
    MEMORY_MARGIN,
    Estimate,
    Estimates,
    bending_modes,
    fit,
    packaged_costs,
    scales,
)

REPOSITORY = Path(__file__).parents[2]


def note(root: Path, stage: str, object_id: str, wall_s: float, memory_bytes: float = 1e8) -> None:
    add_costs(root, stage, Outcome(object_id, None, wall_s, wall_s / 2, int(memory_bytes), "f" * 64))


def test_an_objects_own_last_run_comes_first(tmp_path):
    for seconds in (40.0, 20.0):
        note(tmp_path, "modes", "cup", seconds, memory_bytes=seconds * 1e8)
    note(tmp_path, "modes", "dish", 7.0)
    found = Estimates(tmp_path).of("modes", "cup")
    assert (found.wall_s, found.cpu_s) == (20.0, 10.0)
    # A later peak may miss that of child processes, so the largest counts.
    assert found.memory_bytes == int(4e9 * MEMORY_MARGIN)


def test_the_mean_of_a_stage_stands_for_objects_that_never_ran(tmp_path):
    for index in range(21):
        note(tmp_path, "tune", f"o{index}", 24.0 if index == 0 else 3.0, memory_bytes=(index + 1) * 1e7)
    found = Estimates(tmp_path).of("tune", "new")
    assert found.wall_s == pytest.approx(4.0)
    assert found.memory_bytes >= 20e7


def test_fewer_steps_of_fitting_take_less_of_the_time_of_encoding_and_none_the_least(tmp_path):
    params, learned = REPOSITORY / "params.yaml", tmp_path / "params.yaml"
    learned.write_text(params.read_text().replace("material: known", "material: learned"))
    for size, share in (("default", 1.0), ("small", 0.5125)):  # a quarter of the steps, .65 of the seconds
        assert scales("encode", read_parameters(learned, size)) == (pytest.approx(share), 1.0)
        assert scales("encode", read_parameters(params, size)) == (pytest.approx(0.35), 1.0)


def test_few_runs_set_the_pace_of_this_machine(tmp_path):
    before = Estimates(tmp_path).of("modes", "new")
    for index in range(3):
        note(tmp_path, "modes", f"o{index}", 3 * before.wall_s)
    after = Estimates(tmp_path).of("modes", "new")
    assert after.wall_s == pytest.approx(3 * before.wall_s, rel=0.01)
    assert after.memory_bytes >= before.memory_bytes


def test_packaged_cpu_seconds_are_scaled_by_the_speed_of_this_machine(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "slowness", lambda: 2.0)
    packaged = Estimates(tmp_path)
    assert packaged.cpu_s("modes", "new") == 2 * packaged.of("modes", "new").cpu_s
    note(tmp_path, "modes", "cup", 8.0)
    own = Estimates(tmp_path)
    assert own.cpu_s("modes", "cup") == 4.0
    assert own.cpu_s("modes", "new") == own.of("modes", "new").cpu_s


def test_the_speed_of_this_machine_is_measured_in_a_moment():
    begin = time.process_time()
    assert 0.05 < machine.slowness() < 20
    assert time.process_time() - begin < 1.0  # 0.05 s on an idle machine


def test_a_rendering_is_never_taken_for_one_without_its_child(tmp_path):
    note(tmp_path, "views", "first", 60.0, memory_bytes=3.5e8)
    note(tmp_path, "views", "second", 60.0, memory_bytes=1.3e8)  # the child's peak is no longer seen
    assert Estimates(tmp_path).of("views", "second").memory_bytes >= 3.5e8


def test_bending_modes_are_those_of_a_plate():
    """A simply supported plate has f = π/2 √(D/ρh) (m²/a² + n²/b²) (Leissa, Vibration of Plates)."""
    a, b, h, frequency_hz = 0.5, 0.4, 0.001, 20_000.0
    steel = {"youngs_modulus_pa": 200e9, "density_kg_m3": 7850.0, "poisson_ratio": 0.29}
    bending = steel["youngs_modulus_pa"] * h**3 / 12 / (1 - steel["poisson_ratio"] ** 2)
    m, n = np.meshgrid(np.arange(1, 400), np.arange(1, 400))
    pitch = math.pi / 2 * math.sqrt(bending / (steel["density_kg_m3"] * h)) * ((m / a) ** 2 + (n / b) ** 2)
    measured = {"wall_thickness": {"thin_m": h}, "area_m2": 2 * a * b}
    count = int((pitch < frequency_hz).sum())
    assert bending_modes(measured, steel, frequency_hz) == pytest.approx(count, rel=0.05)


def test_seconds_and_memory_follow_the_load_and_memory_stays_above_nearly_all():
    rng = np.random.default_rng(2)
    loads = rng.lognormal(5, 1, 200)
    peaks = 1e8 * loads**0.5 * rng.lognormal(0, 0.3, 200)
    rows = [Estimate(peak, peak, int(peak), load=load) for load, peak in zip(loads, peaks, strict=True)]
    model = fit(rows)
    above = sum(row.memory_bytes > model.at(row.load).memory_bytes for row in rows)
    assert above <= (1 - HIGH_QUANTILE) * len(rows)
    low, high = model.at(10.0), model.at(1000.0)
    assert high.memory_bytes / low.memory_bytes == pytest.approx(10.0, rel=0.2)
    assert high.wall_s / low.wall_s == pytest.approx(10.0, rel=0.2)
    assert sum(model.at(row.load).wall_s for row in rows) == pytest.approx(peaks.sum(), rel=0.05)


def test_every_stage_has_packaged_costs_and_a_new_data_set_estimates(tmp_path):
    for stage in STAGES:
        found = Estimates(tmp_path).of(stage, "new")
        assert found.wall_s > 0
        assert found.memory_bytes > 5e7
        assert found.product_bytes > (5e3 if stage == "collision" else 1e5)  # a dozen hulls are small


def test_packaged_costs_follow_the_parameters(tmp_path):
    text = (REPOSITORY / "params.yaml").read_text()
    sizes = {}
    for size in ("default", "paper"):
        path = tmp_path / f"{size}.yaml"
        path.write_text(text.replace("size: default", f"size: {size}"))
        estimates = Estimates(tmp_path, read_parameters(path))
        sizes[size] = {stage: estimates.of(stage, "new") for stage in STAGES}
    default, paper = sizes["default"], sizes["paper"]
    unscaled = Estimates(tmp_path)
    assert all(default[stage] == unscaled.of(stage, "new") for stage in set(STAGES) - {"views", "encode"})
    for size, rays in (("default", 128**2 * 24 * 32), ("paper", 256**2 * (500 * 32 + 8 * 256))):
        rays += 12 * 256 * (256**2 if size == "paper" else 128**2)
        packaged = 128**2 * (100 * 32 + 12 * 256)
        assert sizes[size]["views"].wall_s / unscaled.of("views", "new").wall_s == pytest.approx(
            rays / packaged
        )
    assert paper["touches"].product_bytes / default["touches"].product_bytes == pytest.approx(5500 / 150)
    assert paper["modes"] == default["modes"]


def test_memory_of_unseen_objects_is_rarely_above_its_estimate(tmp_path):
    """Half of the packaged objects estimate the other half."""
    for stage in STAGES:
        rows = [(name, cost) for (name, made_by), cost in packaged_costs().items() if made_by == stage]
        if len(rows) < 40:
            continue
        root = tmp_path / stage
        for name, cost in rows[::2]:
            note(root, stage, name, cost.wall_s, cost.memory_bytes)
        allowed = Estimates(root).of(stage, "new").memory_bytes
        above = sum(cost.memory_bytes > allowed for _, cost in rows[1::2])
        assert above <= (1 - HIGH_QUANTILE) * len(rows[1::2]) + 2, stage


@pytest.mark.parametrize(
    "content",
    [
        b"\xff\xfe\x00",
        b"a,b\n1,2\n",
        b'object,stage\n"unclosed',
        b"\x00\x00",
        b"object,stage,fingerprint,cpu_seconds,wall_seconds,peak_memory_mb\nmug,views,f,nan,inf,-1\n",
        b"object,stage,fingerprint,cpu_seconds,wall_seconds,peak_memory_mb\nmug,views,f,1,1,1e308\n",
    ],
)
def test_costs_that_somebody_else_wrote_are_not_there(content, tmp_path):
    path = costs_path(tmp_path)
    path.parent.mkdir()
    path.write_bytes(content)
    assert Estimates(tmp_path).of("views", "mug") == Estimates(tmp_path / "none").of("views", "mug")


def test_an_object_that_measures_nonsense_has_the_usual_estimate(tmp_path):
    extents = {"length": {"extents_m": [0, 0, 0]}, "wall_thickness": {"thin_m": "thin"}, "area_m2": None}
    for object_id, attributes in (("zero", extents), ("bare", {})):
        write_product(OBJECTS.path(tmp_path, object_id), Product({}, attributes))
    for object_id in ("zero", "bare"):
        for stage in ("views", "modes"):
            assert Estimates(tmp_path).of(stage, object_id) == Estimates(tmp_path).of(stage, "none")


def test_a_thousand_objects_are_estimated_at_once(tmp_path):
    path = costs_path(tmp_path)
    path.parent.mkdir(parents=True)
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for index in range(500):
            table.writerows([f"o{index}", stage, "f" * 64, 1.0, 1.0, 100.0, "", ""] for stage in STAGES)
    (tmp_path / MODES.folder).mkdir(parents=True)
    begin = time.process_time()
    estimates = Estimates(tmp_path)
    for index in range(1000):
        for stage in STAGES:
            estimates.of(stage, f"o{index}")
    assert time.process_time() - begin < 2.0  # 0.1 s on an idle machine


def test_estimating_loads_neither_dask_nor_dvc():
    code = "import sys, pipeline.run.forecast.estimates\n"
    code += "print({'dask', 'distributed', 'dvc'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY)
    assert done.stdout.strip() == "set()", done.stderr
