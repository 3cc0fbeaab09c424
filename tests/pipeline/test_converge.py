"""The scenarios of a stage that converges, executions counted."""

import errno
import os
import socket
from contextlib import nullcontext
from pathlib import Path

import pytest
from toys import FILES, INGESTED, QUALITY, TUNED, Here

from objectfolder.products.store import read_attributes, read_product, write_product
from objectfolder.products.tensor_file import read_metadata
from pipeline.dataset.failures import read_failures
from pipeline.dataset.manifest import list_products
from pipeline.dataset.products import read_fingerprint
from pipeline.dataset.verified import Verified
from pipeline.run.damage import set_changed_aside
from pipeline.sandbox import scratch

ALL = sorted(f"{task} {name}" for task in ("ingest", "tune", "encode") for name in ("ball", "cup", "dish"))


def test_first_run_makes_all_and_second_makes_none(toys):
    toys.converge()
    assert toys.executed() == ALL
    before = {path: path.stat().st_mtime_ns for path in toys.root.glob("data/*/*")}
    for summary in toys.converge():
        assert summary.kept == ("ball", "cup", "dish")
        assert summary.exit_code(allow_failures=False) == 0
    assert toys.executed() == []
    assert {path: path.stat().st_mtime_ns for path in toys.root.glob("data/*/*")} == before


def test_products_carry_why_they_are_as_they_are(toys):
    toys.converge()
    attributes = read_attributes(TUNED.path(toys.root, "cup"))
    assert attributes["provenance"]["parameters"] == {"vision.training_views": 5}
    assert attributes["provenance"]["inputs"] == {"ingested": {"digests.shape": "2.0"}}
    assert attributes["provenance"]["record"] == {"material": {"stiffness": 3.0}}
    assert f"{toys.package}.tasks" in attributes["provenance"]["code"]
    metadata = read_metadata(FILES.path(toys.root, "cup"))
    assert metadata["format"] == "toy"
    assert metadata["fingerprint"] == read_attributes(QUALITY.path(toys.root, "cup"))["fingerprint"]


@pytest.mark.parametrize("kind", [INGESTED, FILES], ids=lambda kind: kind.name)
@pytest.mark.parametrize("damage", ["truncated", "one bit", "emptied", "foreign"])
def test_damaged_product_is_noticed_and_made_good(toys, kind, damage):
    toys.converge()
    toys.executed()
    path = kind.path(toys.root, "cup")
    toys.commit()
    whole = path.read_bytes()
    middle = bytearray(whole)
    middle[len(whole) - 3 if kind is FILES else len(whole) // 4] ^= 1
    damaged = {
        "truncated": whole[:-7],
        "one bit": bytes(middle),
        "emptied": b"",
        "foreign": b"PK\x03\x04nothing",
    }
    path.write_bytes(damaged[damage])
    toys.converge()
    assert toys.executed() == []  # DVC's cache has it
    assert path.read_bytes() == whole


def test_a_product_that_changes_while_a_run_goes_on_is_not_listed_as_it_is_then(toys):
    toys.converge()
    verified = Verified(toys.root)
    listed = {entry.path: entry for entry in list_products(toys.root, toys.stages, verified)}
    cup, ball = TUNED.path(toys.root, "cup"), TUNED.path(toys.root, "ball")
    ball.unlink()
    summaries = toys.converge()
    fingerprint = read_fingerprint(cup)
    cup.unlink()
    write_product(cup, read_product(ball).with_attributes(fingerprint=fingerprint))  # whole, and another's
    where = str(cup.relative_to(toys.root))
    assert set_changed_aside(toys.root, listed, summaries, verified) == [where]
    assert not cup.exists()
    assert set_changed_aside(toys.root, listed, summaries, verified) == []


@pytest.mark.parametrize("kind", [INGESTED, FILES], ids=lambda kind: kind.name)
def test_what_is_no_file_in_place_of_a_product_is_replaced(toys, kind):
    toys.converge()
    toys.executed()
    paths = [kind.path(toys.root, name) for name in ("ball", "cup", "dish")]
    whole = [path.read_bytes() for path in paths]
    for path in paths:
        path.unlink()
    os.mkfifo(paths[0])
    paths[1].symlink_to("/dev/zero")
    paths[2].symlink_to(paths[2].name)
    summaries = toys.converge()
    assert not any(summary.failures for summary in summaries)
    assert [path.read_bytes() for path in paths] == whole
    toys.executed()
    paths[0].unlink()
    paths[0].mkdir()  # somebody's, so it stays
    failure = next(failure for summary in toys.converge() for failure in summary.failures)
    assert failure.error.startswith(str(paths[0]))
    assert "is a folder, not a file" in failure.error


def test_a_product_under_another_name_is_not_taken_for_its_own(toys):
    toys.converge()
    toys.executed()
    INGESTED.path(toys.root, "cup").write_bytes(INGESTED.path(toys.root, "ball").read_bytes())
    toys.converge(toys.ingest)
    assert read_attributes(INGESTED.path(toys.root, "cup"))["digests"]["shape"] == "2.0"


def test_one_of_two_kinds_missing_makes_both(toys):
    toys.converge()
    toys.executed()
    QUALITY.path(toys.root, "cup").unlink()
    toys.converge()
    assert toys.executed() == ["encode cup"]


def test_failure_is_data_and_only_what_is_left_is_done_after_mending(toys):
    toys.add("cup", "poison raise ValueError('no cup')")
    ingested, tuned, encoded = toys.converge()
    assert [failure.object for failure in ingested.failures] == ["cup"]
    assert "no cup" in ingested.failures[0].error
    assert "input missing: ingest failed" in tuned.failures[0].error
    assert "input missing: ingest failed" in encoded.failures[0].error
    assert (ingested.exit_code(allow_failures=False), ingested.exit_code(allow_failures=True)) == (1, 0)
    assert len(toys.executed()) == 7
    (failed,) = read_failures(toys.root)  # those behind it are its results
    assert (failed.object, failed.stage) == ("cup", "ingest")
    assert "no cup" in failed.error
    assert failed.fingerprint
    toys.add("cup", "2.5")
    assert all(not summary.failures for summary in toys.converge())
    assert toys.executed() == ["encode cup", "ingest cup", "tune cup"]


def test_a_stage_where_all_fail_does_not_stand(toys):
    for name in list(toys.rows):
        toys.add(name, "poison 1/0")
    (summary,) = toys.converge(toys.ingest)
    assert summary.exit_code(allow_failures=True) == 1


def test_a_failure_beside_products_that_cannot_be_removed_ends_no_run(toys, monkeypatch):
    toys.add("cup", "poison raise ValueError('no cup')")
    products, unlink = toys.root / "data/ingested", Path.unlink

    def refuse(path, missing_ok=False):
        if path.parent == products:
            raise OSError(errno.EROFS, "Read-only file system", str(path))
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", refuse)
    ingested, tuned, _ = toys.converge()
    assert [failure.object for failure in ingested.failures] == ["cup"]
    assert tuned.computed == ("ball", "dish")


def test_half_written_leftovers_are_swept(toys):
    toys.converge()
    leftover = toys.root / "data/ingested/.cup.zarr.zip.x1y2.partial"
    leftover.write_bytes(b"half")
    toys.converge()
    assert not leftover.exists()


def test_longest_expected_first(toys):
    runner = Here()
    toys.add("ball", "1." + "0" * 50)
    toys.converge(toys.ingest, runner_for=lambda jobs: nullcontext(runner))
    assert runner.order[0] == "ingest ball"  # the largest input
    costs = toys.root / ".objectfolder" / "costs.csv"
    rows = costs.read_text().splitlines()
    slow = next(row.split(",") for row in rows if row.startswith("dish,ingest"))
    slow[3] = "100.0"
    costs.write_text("\n".join([*rows, ",".join(slow)]) + "\n" + "cup,ingest,cut sho")
    for name in toys.rows:
        INGESTED.path(toys.root, name).unlink()
    runner.order.clear()
    toys.converge(toys.ingest, runner_for=lambda jobs: nullcontext(runner))
    assert runner.order[0] == "ingest dish"  # the longest last time


def test_an_object_goes_on_as_soon_as_its_own_inputs_are_there(toys):
    runner = Here()
    summaries = toys.flow(runner_for=lambda jobs: nullcontext(runner))
    assert toys.executed() == ALL
    assert [summary.computed for summary in summaries] == [("ball", "cup", "dish")] * 3
    # Not one stage waits for all objects of the one before.
    assert runner.order.index("ingest dish") > runner.order.index("ingest ball")
    for name in ("ball", "cup", "dish"):
        steps = [runner.order.index(f"{stage} {name}") for stage in ("ingest", "tune", "encode")]
        assert steps == sorted(steps)
    assert toys.flow(runner_for=None)[0].kept == ("ball", "cup", "dish")
    assert toys.executed() == []


def test_flow_and_stages_one_by_one_make_the_same_bytes(toys):
    toys.flow()
    flowed = {path: path.read_bytes() for path in toys.root.glob("data/*/*")}
    for path in flowed:
        path.unlink()
    toys.converge()
    assert {path: path.read_bytes() for path in toys.root.glob("data/*/*")} == flowed


def test_failure_in_a_flow_stops_that_object_alone(toys):
    toys.add("cup", "poison raise ValueError('no cup')")
    ingested, tuned, encoded = toys.flow()
    assert ingested.computed == tuned.computed == encoded.computed == ("ball", "dish")
    assert "no cup" in ingested.failures[0].error
    assert "input missing: ingest failed" in encoded.failures[0].error
    toys.executed()
    toys.add("cup", "2.5")
    assert not any(summary.failures for summary in toys.flow())
    assert toys.executed() == ["encode cup", "ingest cup", "tune cup"]


def test_fingerprint_is_independent_of_place(toys):
    toys.converge()
    first = read_fingerprint(INGESTED.path(toys.root, "cup"))
    moved = toys.root / "elsewhere.mesh"
    moved.write_text("2.0")
    toys.rows["cup"]["mesh"] = moved
    toys.converge()
    assert read_fingerprint(INGESTED.path(toys.root, "cup")) == first


def test_a_run_with_nothing_to_do_removes_what_dead_ones_left(toys, tmp_path, monkeypatch):
    monkeypatch.setattr(scratch, "home", lambda: tmp_path / "home")
    toys.add("cup")
    toys.converge()
    left = tmp_path / "home" / scratch.SEPARATOR.join([socket.gethostname(), str(2**22), "1.00", "task-a"])
    left.mkdir(parents=True)
    mark = toys.root / ".objectfolder" / "shared-0"
    mark.touch()
    toys.converge()
    assert not left.exists()
    assert not mark.exists()
