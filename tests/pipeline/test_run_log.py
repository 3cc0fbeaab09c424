"""What is kept of runs: costs, the last failures, and a record that survives kills and two writers."""

import csv
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from toys import read_record

from objectfolder.errors import InputError, SimulationError
from pipeline.dataset.failures import FAILURES, FailedObject, read_failures, write_failures
from pipeline.dataset.stages import STAGES
from pipeline.dataset.task import Failure, Outcome
from pipeline.publish.report.measured_objects import MeasuredObject
from pipeline.run import costs as table_of_costs
from pipeline.run import run_record
from pipeline.run.costs import (
    COLUMNS,
    KEPT_ROWS,
    QUERY,
    add_costs,
    compact,
    costs_by_fingerprint,
    costs_path,
    known_costs,
)
from pipeline.run.estimates import last_costs
from pipeline.run.run_record import RunRecord, records

FINGERPRINTS = [f"{index:064x}" for index in range(12)]


def outcome(name, seconds=1.0, fingerprint=FINGERPRINTS[0], megabytes=100, queries=None):
    return Outcome(name, None, seconds, seconds, megabytes * 10**6, fingerprint, queries or {})


def last_seconds(root):
    return {key: cost.cpu_s for key, cost in last_costs(known_costs(root)).items()}


def test_costs_are_known_by_fingerprint_and_kept_for_the_next_run(tmp_path):
    for index, seconds in enumerate((3.0, 5.0)):
        add_costs(tmp_path, "views", outcome("mug", seconds, FINGERPRINTS[index]))
    costs = costs_by_fingerprint(tmp_path)
    assert costs[FINGERPRINTS[0]].wall_s == 3.0
    assert FINGERPRINTS[2] not in costs
    assert last_seconds(tmp_path) == {("mug", "views"): 5.0}


def test_a_line_that_a_kill_cut_short_costs_no_other_line(tmp_path):
    add_costs(tmp_path, "views", outcome("mug", 3.0))
    whole = costs_path(tmp_path).read_bytes()
    costs_path(tmp_path).write_bytes(whole + b"dish,views,00ab,1.")
    add_costs(tmp_path, "views", outcome("cup", 4.0))
    assert last_seconds(tmp_path) == {("mug", "views"): 3.0, ("cup", "views"): 4.0}
    (dish,) = (cost for cost in known_costs(tmp_path) if cost.object_id == "dish")
    assert dish.wall_s is None  # it stands there with nothing measured


@pytest.mark.parametrize("seconds", ["nan", "inf", "-1", ""])
def test_a_cost_that_is_no_number_is_not_there(seconds, tmp_path):
    add_costs(tmp_path, "views", outcome("mug", 7.5))
    path = costs_path(tmp_path)
    path.write_text(path.read_text().replace("7.5", seconds))
    assert costs_by_fingerprint(tmp_path) == {}
    assert last_seconds(tmp_path) == {}


def test_compacting_keeps_what_estimates_and_report_need(tmp_path, monkeypatch):
    for name in ("mug", "cup"):
        for index, fingerprint in enumerate(FINGERPRINTS):
            queries = {"views": index, "modes": 2 * index}
            result = outcome(name, index, fingerprint, 900 if index == 11 else 100, queries)
            add_costs(tmp_path, "fidelity", result)
            add_costs(tmp_path, "fidelity", outcome(name, index + 0.5, fingerprint))  # the same again
    with costs_path(tmp_path).open("a") as file:
        file.write("dish,fidelity,00ab,1.")
    before, estimates = costs_path(tmp_path).stat().st_size, last_costs(known_costs(tmp_path))
    compact(tmp_path)
    assert costs_path(tmp_path).stat().st_size == before  # small enough as it is
    monkeypatch.setattr(table_of_costs, "COMPACT_ABOVE_BYTES", 1000)
    compact(tmp_path)
    assert costs_path(tmp_path).stat().st_size < before / 2
    assert last_costs(known_costs(tmp_path)) == estimates
    costs = costs_by_fingerprint(tmp_path)
    rows_left = [cost for cost in known_costs(tmp_path) if cost.object_id == "mug"]
    for fingerprint in FINGERPRINTS[-KEPT_ROWS:]:
        index = FINGERPRINTS.index(fingerprint)
        if index > 9:  # each ran twice
            assert costs[fingerprint].wall_s == index + 0.5
        setting = {
            "speed_error": [{"key": "modes"}],
            "provenance": {"fingerprints": {"fidelity": fingerprint}},
        }
        (effort,) = MeasuredObject("mug", setting, rows_left).efforts
        assert effort["seconds_per_query"] == 2 * index
    assert FINGERPRINTS[0] not in costs
    with costs_path(tmp_path).open(newline="") as file:
        rows = list(csv.reader(file))
    assert tuple(rows[0]) == COLUMNS
    assert {len(row) for row in rows} == {len(COLUMNS)}
    assert sum(row[1] == QUERY for row in rows) == 2 * 2 * KEPT_ROWS
    size = costs_path(tmp_path).stat().st_size
    compact(tmp_path)
    assert costs_path(tmp_path).stat().st_size == size


WRITER = """
import sys
from pathlib import Path
from pipeline.run import costs as table_of_costs
from pipeline.run.costs import add_costs, compact
from pipeline.run.run_record import RunRecord
from pipeline.dataset.task import Outcome

table_of_costs.COMPACT_ABOVE_BYTES = 1000
with RunRecord(Path.cwd(), ["views"]) as record:
    for index in range(200):
        done = Outcome(f"{sys.argv[1]}_{index % 20}", None, index, index, 10**6, f"{index:064x}")
        add_costs(Path.cwd(), "views", done)
        record.task("views", done, slot=sys.argv[1])
        if index % 25 == 0:
            compact(Path.cwd())
"""


def test_two_writers_lose_nothing_of_each_other(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, name], cwd=tmp_path, stderr=subprocess.PIPE)
        for name in ("one", "two")
    ]
    for writer in writers:
        assert writer.wait(120) == 0, writer.stderr.read()
        writer.stderr.close()
    seconds = last_seconds(tmp_path)
    for name in ("one", "two"):
        assert [seconds[f"{name}_{index}", "views"] for index in range(20)] == list(range(180, 200))
    lines = [read_record(path) for path in records(tmp_path)]
    assert [[line["wall_s"] for line in own[1:-1]] for own in lines] == [list(range(200))] * 2


def test_a_record_says_what_ran_where_and_how_it_ended(tmp_path):
    failure = Failure("cup", "no faces", "Export it again.", "x" * 10_000)
    with RunRecord(tmp_path, ["views"]) as record:
        record.task("views", outcome("mug", 2.5), "tcp://10.0.0.1:1", "alpha", 2)
        record.task("views", Outcome("cup", failure))
        record.stage("views", ["dish"], kept=7, restored=1, computed=1, failed=1)
    (path,) = records(tmp_path)
    start, mug, cup, stage, end = read_record(path)
    assert path.stem == start["run"] == end["run"] == record.run_id
    assert start["stages"] == ["views"]
    assert (mug["object"], mug["outcome"], mug["slot"], mug["host"], mug["tries"]) == (
        "mug",
        "computed",
        "tcp://10.0.0.1:1",
        "alpha",
        2,
    )
    assert (mug["wall_s"], mug["peak_memory_mb"], mug["fingerprint"]) == (2.5, 100.0, FINGERPRINTS[0])
    assert (cup["outcome"], cup["error"], cup["remedy"]) == ("failed", "no faces", "Export it again.")
    assert len(cup["detail"]) < 3000
    assert (stage["kept"], stage["removed"]) == (7, ["dish"])
    assert (end["tasks"], end["error"]) == (2, None)


def test_a_record_tells_an_interrupted_run(tmp_path):
    with pytest.raises(KeyboardInterrupt), RunRecord(tmp_path, ["views"]):
        raise KeyboardInterrupt
    (path,) = records(tmp_path)
    assert read_record(path)[-1]["error"] == "KeyboardInterrupt: "


def test_records_are_capped_in_number_and_in_size(tmp_path, monkeypatch):
    monkeypatch.setattr(run_record, "MOST_RUNS", 3)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "views.jsonl").write_text("{}\n")
    for day in range(1, 7):
        (tmp_path / "runs" / f"2026010{day}T000000Z-00000000.jsonl").write_text("x" * 1000)
    with RunRecord(tmp_path, ["views"]) as record:
        pass
    assert [path.name[:8] for path in records(tmp_path)][:2] == ["20260105", "20260106"]
    assert records(tmp_path)[-1] == record.path
    monkeypatch.setattr(run_record, "MOST_BYTES", 1500 + record.path.stat().st_size)
    for path in run_record.excess(tmp_path):
        path.unlink()
    assert [path.name[:8] for path in records(tmp_path)][:-1] == ["20260106"]
    monkeypatch.setattr(run_record, "MOST_BYTES", 1)
    for path in run_record.excess(tmp_path):
        path.unlink()
    assert records(tmp_path) == [record.path]  # the last one stays
    assert (tmp_path / "runs" / "views.jsonl").exists()


def test_failures_stay_until_their_stage_runs_again_and_results_of_others_are_left_out(tmp_path):
    def failed(stage, fingerprint=""):
        return FailedObject("cup", stage, f"{tmp_path}/mesh.obj: no faces", "Export it again.", fingerprint)

    def stages():
        return [failure.stage for failure in read_failures(tmp_path)]

    write_failures(tmp_path, [failed("views", "ab"), failed("modes"), failed("encode")], [*STAGES.values()])
    assert stages() == ["views", "modes"]
    assert read_failures(tmp_path)[0] == replace(failed("views", "ab"), error="mesh.obj: no faces")
    write_failures(tmp_path, [], [STAGES["views"]], others={"cup"})
    assert stages() == ["views", "modes"]
    write_failures(tmp_path, [failed("encode")], [STAGES["views"], STAGES["encode"]])
    assert stages() == ["modes"]
    (tmp_path / FAILURES).write_text('[{"object": "cu')
    with pytest.raises(InputError, match="dvc repro"):
        read_failures(tmp_path)
    write_failures(tmp_path, [], [])
    assert stages() == []


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "runs").write_text("a file where a folder should be")
    (tmp_path / ".objectfolder").write_text("the same")
    with pytest.raises(SimulationError, match="cannot be written"):
        RunRecord(tmp_path, ["views"])
    with pytest.raises(SimulationError, match="nothing finished is lost"):
        add_costs(tmp_path, "views", outcome("mug"))
