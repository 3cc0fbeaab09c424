"""What a run is said to do and take, against what it then does and takes."""

import json
import os
import re
import shutil
from pathlib import Path

import pytest
from toys import Toys

from pipeline.cli import main
from pipeline.cluster.places import Adapt, Place
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.stages import STAGES
from pipeline.dataset.task import Outcome
from pipeline.run.costs import add_costs
from pipeline.run.estimates import TYPICAL
from pipeline.run.plan import Machines, Plan, machines_of, plan, plan_for_count

REPOSITORY = Path(__file__).parents[2]
MACHINES = Machines(1, 2, 16 * 10**9)


def planned(toys: Toys) -> Plan:
    return plan(toys.root, toys.parameters, toys.rows, MACHINES, [8], toys.stages)


def counts(estimate: Plan) -> dict[str, tuple[int, int, int]]:
    return {name: (stage.kept, stage.restored, stage.computed) for name, stage in estimate.stages.items()}


def test_what_is_kept_restored_and_computed_is_what_a_run_then_does(toys: Toys) -> None:
    assert counts(planned(toys)) == {"ingest": (0, 0, 3), "tune": (0, 0, 3), "encode": (0, 0, 3)}
    toys.flow()
    assert counts(planned(toys)) == {"ingest": (3, 0, 0), "tune": (3, 0, 0), "encode": (3, 0, 0)}
    toys.executed()
    toys.commit()
    toys.add("vase", "4.0")
    (toys.root / "data" / "files" / "cup.safetensors").unlink()
    expected = counts(planned(toys))
    assert expected == {"ingest": (3, 0, 1), "tune": (3, 0, 1), "encode": (2, 1, 1)}
    for summary in toys.flow():
        done = (len(summary.kept), len(summary.restored), len(summary.computed))
        assert done == expected[summary.stage]


def test_planning_changes_nothing(toys: Toys) -> None:
    toys.flow()
    toys.executed()
    (toys.root / "data" / "files" / "cup.safetensors").unlink()
    planned(toys)
    assert not (toys.root / "data" / "files" / "cup.safetensors").exists()
    assert toys.executed() == []


def test_what_is_missing_in_the_cache_too_is_computed(toys: Toys) -> None:
    toys.flow()
    (toys.root / "data" / "files" / "cup.safetensors").unlink()
    assert counts(planned(toys))["encode"] == (2, 0, 1)


def test_known_tasks_sum_up_and_share_workers_and_memory(toys: Toys) -> None:
    for object_id, seconds in zip(toys.rows, (10.0, 20.0, 30.0), strict=True):
        for stage in toys.stages:
            add_costs(toys.root, stage.name, Outcome(object_id, None, seconds, seconds, 6 * 10**9, "f" * 64))
    estimate = planned(toys)
    assert estimate.stages["tune"].cpu_s == pytest.approx(60.0)
    assert estimate.chain_s == pytest.approx(90.0)
    assert [wall.at_least_s for wall in estimate.wall.values()] == pytest.approx([180.0, 90.0, 90.0])
    assert [wall.expected_s for wall in estimate.wall.values()] == pytest.approx([180.0, 90.0, 90.0])
    scarce = plan(toys.root, toys.parameters, toys.rows, Machines(1, 2, 8 * 10**9), stages=toys.stages)
    assert scarce.wall[2].at_least_s == pytest.approx(90.0)
    assert scarce.wall[2].expected_s == pytest.approx(180.0)  # two do not fit beside each other


def test_a_plan_for_objects_to_come_grows_with_their_number(tmp_path: Path) -> None:
    # As typical costs were taken.
    text = (REPOSITORY / "params.yaml").read_text()
    text = text.replace("material: known", "material: learned").replace(
        "training_views: 24", "training_views: 100"
    )
    (tmp_path / "params.yaml").write_text(text)
    parameters = read_parameters(tmp_path / "params.yaml")
    few, many = (plan_for_count(tmp_path, parameters, count, MACHINES, [64]) for count in (50, 200))
    for name in STAGES:
        assert many.stages[name].computed == 200
        assert many.stages[name].cpu_s == pytest.approx(200 * TYPICAL[name].cpu_s)
        assert many.stages[name].product_bytes == pytest.approx(4 * few.stages[name].product_bytes, rel=1e-6)
    assert many.wall[1].expected_s == pytest.approx(4 * few.wall[1].expected_s)
    assert many.chain_s <= many.wall[64].at_least_s <= many.wall[64].expected_s


def test_a_plan_at_the_papers_size_costs_more_where_the_law_is_known(tmp_path: Path) -> None:
    text = (REPOSITORY / "params.yaml").read_text().replace("size: default", "size: paper")
    (tmp_path / "params.yaml").write_text(text)
    paper = plan_for_count(tmp_path, read_parameters(tmp_path / "params.yaml"), 20, MACHINES)
    default = plan_for_count(tmp_path, read_parameters(REPOSITORY / "params.yaml"), 20, MACHINES)
    assert paper.stages["views"].cpu_s > 10 * default.stages["views"].cpu_s
    assert paper.stages["modes"].cpu_s == default.stages["modes"].cpu_s


def test_places_say_how_many_tasks_run_at_a_time() -> None:
    assert machines_of(Place(kwargs={"threads_per_worker": 3}, memory_gb=8.0)) == Machines(1, 3, 8 * 10**9)
    ssh = Place(class_name="SSHCluster", kwargs={"hosts": ["a", "a", "b"]})
    assert machines_of(ssh).workers == 2 * os.cpu_count()
    slurm = Place(kwargs={"cores": 16, "memory": "64 GB"}, adapt=Adapt(maximum=5))
    assert machines_of(slurm) == Machines(5, 16, int(0.9 * 64e9))
    assert Machines(1, 8, 8 * 10**9).beside(3 * 10**9) == 2
    assert Machines(1, 8, 8 * 10**9).beside(9 * 10**9) == 1  # alone


def test_the_command_prints_a_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "data").mkdir()
    shutil.copy(REPOSITORY / "data" / "materials.csv", tmp_path / "data")
    (tmp_path / "params.yaml").write_text(
        (REPOSITORY / "params.yaml").read_text().replace("data/starter.csv", "objects.csv")
    )
    (tmp_path / "cube.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n")
    (tmp_path / "objects.csv").write_text("id,mesh,material,length_m\ncube,cube.obj,steel,0.1\n")
    monkeypatch.chdir(tmp_path)
    assert main(["plan", "--workers", "8"]) == 0
    assert "1 object," in capsys.readouterr().out
    assert main(["plan", "--json"]) == 0
    stages = json.loads(capsys.readouterr().out)["stages"]
    assert [stage["computed"] for stage in stages.values()] == [1] * len(STAGES)
    assert main(["plan", "--count", "12", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["objects"] == 12
    page = (REPOSITORY / "docs" / "make.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^objectfolder (plan [^#\n]*)", page, re.MULTILINE)
    assert main(line.split()) == 0
    assert "1000 objects" in capsys.readouterr().out
    assert main(["plan", "--count", "-1"]) == 2
    assert "1" in capsys.readouterr().err
