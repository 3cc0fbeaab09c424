"""What tasks are expected to take: own runs first, then the mean of the stage, then typical costs."""

import csv
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.stages import MODES, STAGES
from pipeline.dataset.task import Outcome
from pipeline.run.costs import COLUMNS, add_costs, costs_path, read_costs
from pipeline.run.estimates import (
    ENOUGH_ROWS,
    MEMORY_MARGIN,
    TYPICAL,
    Estimate,
    Estimates,
    last_costs,
    scaled,
)

REPOSITORY = Path(__file__).parents[2]
SCANS = REPOSITORY / "bench" / "factory" / "known_costs.csv"


def note(root: Path, stage: str, object_id: str, cpu_s: float, memory_bytes: float = 1e8) -> None:
    add_costs(root, stage, Outcome(object_id, None, 2 * cpu_s, cpu_s, int(memory_bytes), "f" * 64))


def test_an_objects_own_last_run_comes_first(tmp_path):
    for seconds in (40.0, 20.0):
        note(tmp_path, "modes", "cup", seconds, memory_bytes=seconds * 1e8)
    note(tmp_path, "modes", "dish", 7.0)
    cup = Estimates(tmp_path).of("modes", "cup")
    assert cup.cpu_s == 20.0
    # A later peak may miss that of child processes, so the largest counts.
    assert cup.memory_bytes == int(4e9 * MEMORY_MARGIN)


def test_the_mean_of_a_stage_stands_for_objects_that_never_ran(tmp_path):
    for index in range(21):
        note(tmp_path, "tune", f"o{index}", 24.0 if index == 0 else 3.0, memory_bytes=(index + 1) * 1e7)
    new = Estimates(tmp_path).of("tune", "new")
    assert new.cpu_s == pytest.approx(4.0)
    assert new.memory_bytes == int(21e7 * MEMORY_MARGIN)


def test_a_few_small_objects_do_not_lower_the_memory_of_others(tmp_path):
    for index in range(ENOUGH_ROWS):
        assert Estimates(tmp_path).of("modes", "new").memory_bytes == TYPICAL["modes"].memory_bytes
        note(tmp_path, "modes", f"o{index}", 1.0)
    assert Estimates(tmp_path).of("modes", "new").memory_bytes == int(1e8 * MEMORY_MARGIN)


def test_a_rendering_is_never_taken_for_one_without_its_child(tmp_path):
    note(tmp_path, "views", "first", 60.0, memory_bytes=6e8)
    note(tmp_path, "views", "second", 60.0, memory_bytes=1.3e8)  # the child's peak is no longer seen
    assert Estimates(tmp_path).of("views", "second").memory_bytes >= 6e8


def test_typical_costs_are_the_means_of_the_scans_and_their_memory_that_of_nearly_all():
    assert TYPICAL.keys() == STAGES.keys()
    recorded = last_costs(read_costs(SCANS))
    for stage, typical in TYPICAL.items():
        costs = [cost for (_, made_by), cost in recorded.items() if made_by == stage]
        assert typical.cpu_s == pytest.approx(np.mean([cost.cpu_s for cost in costs]), rel=0.02)
        assert np.mean([cost.memory_bytes > typical.memory_bytes for cost in costs]) <= 0.085, stage


def test_typical_costs_follow_the_parameters(tmp_path):
    typical = Estimate(1.0, 10**8, 10**6)
    params, learned = REPOSITORY / "params.yaml", tmp_path / "params.yaml"
    learned.write_text(params.read_text().replace("material: known", "material: learned"))
    for size, share in (("default", 1.0), ("small", 0.5125)):  # a quarter of the steps, .65 of the seconds
        assert scaled("encode", typical, read_parameters(learned, size)).cpu_s == pytest.approx(share)
        assert scaled("encode", typical, read_parameters(params, size)).cpu_s == pytest.approx(0.35)
    default, paper = (read_parameters(params, size) for size in ("default", "paper"))
    rays = 128**2 * (100 * 32 + 12 * 256)
    assert scaled("views", typical, default).cpu_s == pytest.approx(128**2 * (24 * 32 + 12 * 256) / rays)
    assert scaled("views", typical, paper).cpu_s == pytest.approx(256**2 * (500 * 32 + 20 * 256) / rays)
    assert scaled("touches", typical, default) == typical
    assert scaled("touches", typical, paper).product_bytes == pytest.approx(10**6 * 5500 / 150)
    assert scaled("modes", typical, paper) == typical


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
    code = "import sys, pipeline.run.estimates\n"
    code += "print({'dask', 'distributed', 'dvc'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY)
    assert done.stdout.strip() == "set()", done.stderr
