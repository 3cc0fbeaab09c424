"""What the status says of every object and stage, and why."""

import json
import shutil

import pytest
from workshop import made as all_made

from pipeline.cli import main
from pipeline.dataset.differences import Reason, differences
from pipeline.dataset.stages import ENCODED, MODES, OBJECTS, STAGES, VIEWS
from pipeline.run import status as status_module
from pipeline.run.exclusive import exclusive
from pipeline.run.status import CURRENT, FAILED, MISSING, STALE, UNLISTED, WAITING, status, table


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A checkout where all is made."""
    folder = tmp_path_factory.mktemp("status")
    with all_made(folder, "workshop_of_status", cup="steel", dish="wood") as workshop:
        yield workshop


@pytest.fixture
def workshop(made):
    made.restore()
    return made


def states(workshop, object_id):
    return {row.stage: row.state for row in of(workshop) if row.object_id == object_id}


def of(workshop):
    return status(workshop.root, workshop.stages)


def reasons(workshop, object_id, stage):
    (row,) = (row for row in of(workshop) if (row.object_id, row.stage) == (object_id, stage))
    assert row.state == STALE
    return row.reasons


def test_all_current_after_a_run(workshop):
    rows = of(workshop)
    assert [(row.object_id, row.stage) for row in rows] == [
        (object_id, stage) for object_id in ("cup", "dish") for stage in STAGES
    ]
    assert {row.state for row in rows} == {CURRENT}


def test_nothing_made_yet(workshop):
    shutil.rmtree(workshop.root / "data/objects")
    shutil.rmtree(workshop.root / "data/views")
    assert states(workshop, "cup") == {
        "objects": MISSING, "views": WAITING, "modes": WAITING, "touches": WAITING,
        "collision": WAITING, "encode": WAITING, "fidelity": WAITING,
    }  # fmt: skip


def test_changed_parameter_with_old_and_new(workshop):
    workshop.edit("params.yaml", "resolution: 128", "resolution: 64")
    assert reasons(workshop, "cup", "views") == ("parameter vision.resolution 128 -> 64",)
    assert states(workshop, "cup") == {
        "objects": CURRENT, "views": STALE, "modes": CURRENT, "touches": CURRENT,
        "collision": CURRENT, "encode": WAITING, "fidelity": WAITING,
    }  # fmt: skip


def test_changed_material_with_old_and_new(workshop):
    workshop.edit("data/materials.csv", "wood,750,", "wood,760,")
    assert reasons(workshop, "dish", "modes") == ("record material.density_kg_m3 750.0 -> 760.0",)
    assert set(states(workshop, "cup").values()) == {CURRENT}


def test_changed_inputs_code_and_seed(workshop):
    workshop.write("cup.png", "another colour")
    assert reasons(workshop, "cup", "objects") == ("input texture changed",)
    workshop.edit_code("units", "PASCAL = 1.0", "PASCAL = 2.0")
    (why,) = reasons(workshop, "dish", "modes")
    assert why == f"code {workshop.bodies.name}.units changed"
    workshop.edit("params.yaml", "\nseed: 0", "\nseed: 1")
    assert any(why.startswith("seed ") and " -> " in why for why in reasons(workshop, "dish", "touches"))


def test_input_that_was_made_again_by_a_stage_alone(workshop):
    workshop.edit("params.yaml", "resolution: 128", "resolution: 64")
    stages, workshop.stages = workshop.stages, workshop.stages[:2]
    workshop.converge()
    workshop.stages = stages
    assert reasons(workshop, "cup", "encode") == ("input views changed",)
    assert states(workshop, "cup")["fidelity"] == STALE


def test_failure_counts_until_what_it_was_made_from_changes(workshop):
    workshop.write("cup.obj", "poison")
    workshop.converge()
    assert states(workshop, "cup") == {"objects": FAILED, **dict.fromkeys(list(STAGES)[1:], WAITING)}
    (row,) = (row for row in of(workshop) if row.state == FAILED)
    assert "no mesh" in row.reasons[0]
    workshop.write("cup.obj", "v 0 0 7\n")
    assert states(workshop, "cup")["objects"] == MISSING


def test_source_file_that_is_gone(workshop):
    (workshop.root / "cup.png").unlink()
    rows = [row for row in of(workshop) if row.object_id == "cup"]
    assert rows[0].state == FAILED
    assert "cup.png" in rows[0].reasons[0]


@pytest.mark.parametrize("kind", [OBJECTS, VIEWS, MODES, ENCODED], ids=lambda kind: kind.name)
def test_damaged_product_is_unreadable(workshop, kind):
    path = kind.path(workshop.root, "cup")
    path.write_bytes(path.read_bytes()[:-9])
    (why,) = reasons(workshop, "cup", kind.made_by)
    assert why.startswith("unreadable: ")


def test_object_no_longer_listed(workshop):
    workshop.table.pop()
    workshop.save()
    assert states(workshop, "dish") == dict.fromkeys(STAGES, UNLISTED)
    workshop.converge()
    assert states(workshop, "dish") == {}


def test_products_are_not_read_again(workshop, monkeypatch):
    of(workshop)

    def read(path):
        raise AssertionError(f"read {path}")

    monkeypatch.setattr("pipeline.dataset.products.read_description", read)
    assert {row.state for row in of(workshop)} == {CURRENT}


def test_status_leaves_the_checkout_to_a_run(workshop):
    cache = workshop.root / ".objectfolder" / "verified.json"
    cache.unlink()
    with exclusive(workshop.root, "stage views"):
        of(workshop)
        assert not cache.exists()
    of(workshop)
    assert cache.exists()


def test_table_groups_objects_by_reason(workshop):
    workshop.edit("params.yaml", "resolution: 128", "resolution: 64")
    workshop.write("cup.obj", "v 0 0 7\n")
    text = table(of(workshop))
    assert "views stale: cup, dish (parameter vision.resolution 128 -> 64)" in text
    assert "objects stale: cup (input mesh changed)" in text
    assert text.splitlines()[0].split() == ["stage", "current", "stale", "waiting"]
    assert text.splitlines()[1].split() == ["objects", "1", "1"]


def test_what_a_mesh_says_of_itself_is_shown(workshop):
    assert not any(row.warnings for row in of(workshop))
    for name in ("cup", "dish"):
        workshop.write(f"{name}.obj", f"o doubtful {name}\n")
    workshop.converge()
    rows = of(workshop)
    assert {(row.object_id, row.stage) for row in rows if row.warnings} == {
        ("cup", "objects"),
        ("dish", "objects"),
    }
    assert {row.state for row in rows} == {CURRENT}
    assert table(rows).splitlines()[-1] == "warning: cup, dish: its walls are doubtful"


def test_a_wish_that_modes_did_not_reach_is_shown(workshop):
    workshop.edit("params.yaml", "accuracy_cents: 5.0", "accuracy_cents: 0.5")
    workshop.converge()
    assert table(of(workshop)).splitlines()[-1] == "warning: dish: accuracy_cents is not reached"


def test_command(workshop, monkeypatch, capsys):
    monkeypatch.chdir(workshop.root)
    monkeypatch.setattr(status_module.status, "__defaults__", (workshop.stages, None, None))
    assert main(["status"]) == 0
    assert "objects          2" in capsys.readouterr().out
    workshop.edit("params.yaml", "resolution: 128", "resolution: 64")
    assert main(["status", "--json"]) == 1
    rows = json.loads(capsys.readouterr().out)
    assert rows[1]["differences"] == [
        {"kind": "parameter", "name": "vision.resolution", "old": 128, "new": 64, "note": ""}
    ]


def test_differences_of_every_part():
    old = {"inputs": {"views": "a", "objects": {"digests.body": "b"}}, "packages": {"numpy": "1"}, "seed": 1}
    new = {
        "inputs": {"views": "c", "modes": "d"},
        "packages": {"numpy": "2"},
        "seed": 1,
        "record": {"x": None},
    }
    assert differences(old, new) == [
        Reason("input", "modes", "absent", "d"),
        Reason("input", "objects.digests.body", "b", "absent"),
        Reason("input", "views", "a", "c"),
        Reason("record", "x", "absent", None),
        Reason("package", "numpy", "1", "2"),
    ]
    assert [str(reason) for reason in differences(old, new)] == [
        "input modes is new",
        "input objects.digests.body is gone",
        "input views changed",
        "record x absent -> None",
        "package numpy 1 -> 2",
    ]


@pytest.mark.parametrize("name", ["verified.json", "code.json"])
@pytest.mark.parametrize(
    "text",
    [
        "",
        "[1]",
        "[" * 100_000,
        "\x00\xff",
        '{"products": [1], "sources": 3}',
        '{"products": {"x": 1}, "y": [1, 2]}',
    ],
    ids=["empty", "list", "deep", "bytes", "shapes", "entries"],
)
def test_a_foreign_cache_counts_as_none(workshop, name, text):
    (workshop.root / ".objectfolder" / name).write_text(text)
    assert {row.state for row in of(workshop)} == {CURRENT}


def test_a_foreign_entry_of_a_product_counts_as_none(workshop):
    path = workshop.root / ".objectfolder" / "verified.json"
    cache = json.loads(path.read_text())
    cache["products"] = {key: {"state": "now", "whole": 1} for key in cache["products"]}
    path.write_text(json.dumps(cache))
    assert {row.state for row in of(workshop)} == {CURRENT}
