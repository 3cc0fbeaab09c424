"""The reason of each change, over the real declarations of stages: every seeded change named rightly."""

import importlib
import json
import zipfile

import numpy as np
import pytest
from versions_of_workshop import flip, made_versions, only, states

from objectfolder.products import provenance as provenance_module
from objectfolder.products.store import Array, Product, read_product, write_product
from pipeline.audit import reasons
from pipeline.audit.fidelity import exceeded
from pipeline.audit.findings import State, groups
from pipeline.audit.reasons import (  # fmt: skip
    BYTES,
    CODE,
    CORRUPTED,
    MATERIAL,
    MESH,
    MISLABELLED,
    PACKAGE,
    PARAMETER,
    RECORD,
    ROW,
    SEED,
    TEXTURE,
    TOLERANCE,
    UPSTREAM,
    Circumstances,
    _source,
)
from pipeline.dataset import stage as stage_module
from pipeline.dataset.stages import MODES, OBJECT_FILES, STAGES, TOUCHES, VIEWS
from pipeline.dataset.tolerances import as_json

pytestmark = pytest.mark.slow

MATERIALS = {"cup": "steel", "dish": "wood", "spoon": "wood"}
IDS = tuple(MATERIALS)
PACKAGE_NAME = "workshop_of_reasons"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A checkout with one version."""
    with made_versions(tmp_path_factory.mktemp("reasons"), PACKAGE_NAME, **MATERIALS) as workshop:
        yield workshop


@pytest.fixture
def workshop(made):
    made.restore()
    return made


def audit_of_change(workshop):
    """Keep what was changed as a second version and compare."""
    return workshop.audit(workshop.first, workshop.version("second"))


def told(audit, object_id):
    """Kind and name of every reason of an object that is no consequence."""
    return {(reason.kind, reason.name) for reason in only(audit, object_id).roots}


def stages_of(audit, object_id):
    """Stages that changed for reasons of their own, and those that only follow."""
    (group,) = (
        candidate
        for candidate in groups(audit)
        if object_id in [changed.object_id for changed in candidate.objects]
    )
    return set(group.direct), set(group.behind)


def sentences(audit, object_id):
    return [str(reason) for reason in only(audit, object_id).roots]


def reasons_by_stage(audit, object_id):
    """What each stage that changed says, but for consequences."""
    return {
        change.stage: {(reason.kind, reason.name) for reason in change.reasons if reason.kind != UPSTREAM}
        for change in only(audit, object_id).stages
    }


@pytest.mark.parametrize(
    ("change", "found", "direct", "behind"),
    [
        ({"material": "glass"}, {(MATERIAL, "")}, {"views", "modes", "fidelity"}, {"encode"}),
        (
            {"licence": "CC BY 4.0", "attribution": "B. Maker"},
            {(RECORD, "licence"), (RECORD, "attribution")},
            {"fidelity"},
            set(),
        ),
        ({"cup.png": "another colour"}, {(TEXTURE, "")}, {"objects"}, {"views", "encode", "fidelity"}),
        ({"cup.obj": "v 0 0 9\n"}, {(MESH, "")}, {"objects"}, set(STAGES) - {"objects"}),
    ],
    ids=["material", "cells", "texture", "mesh"],
)
def test_change_of_one_object(workshop, change, found, direct, behind):
    for name, value in change.items():
        if name.startswith("cup."):
            workshop.write(name, value)
        else:
            workshop.row("cup")[name] = value
    workshop.save()
    audit = audit_of_change(workshop)
    assert states(audit) == {"cup": State.CHANGED, "dish": State.UNCHANGED, "spoon": State.UNCHANGED}
    assert told(audit, "cup") == found
    assert stages_of(audit, "cup") == (direct, behind)


def test_row_of_a_material(workshop):
    workshop.edit("data/materials.csv", "wood,750,", "wood,760,")
    workshop.edit("data/materials.csv", ",60,2e-6,0.7,0,", ",61,2e-6,0.6,0,")
    workshop.edit("data/materials.csv", "isotropic; roughness: ours", "isotropic; roughness: guessed")
    workshop.edit("data/materials.csv", ',0.005,0,"chip board', ',0.006,0,"chipboard')
    audit = audit_of_change(workshop)
    assert states(audit) == {"cup": State.UNCHANGED, "dish": State.CHANGED, "spoon": State.CHANGED}
    sound = {(ROW, f"wood.{name}") for name in ("density_kg_m3", "rayleigh_alpha_per_s", "loss_factor")}
    for object_id in ("dish", "spoon"):
        stages = reasons_by_stage(audit, object_id)
        assert stages["views"] == {(ROW, "wood.roughness")}
        assert stages["modes"] == sound
        assert stages["fidelity"] >= sound | {(ROW, "wood.citation"), (ROW, "wood.loss_citation")}
        assert "material row wood.density_kg_m3 750.0 -> 760.0" in sentences(audit, object_id)
    assert len(groups(audit)) == 1


PARAMETERS = [
    ("    vision:\n      resolution: 128", "    vision:\n      resolution: 64", "vision.resolution", "views"),
    ("accuracy_cents: 5.0", "accuracy_cents: 6.0", "audio.accuracy_cents", "modes"),
    ("damping: loss_factor #", "damping: rayleigh #", "audio.damping", "modes"),
    ("      touches: 100\n", "      touches: 90\n", "touch.touches", "touches"),
    ("contact: rigid # as TACTO", "contact: elastic # as TACTO", "touch.contact", "touches"),
    ("threshold_m: null #", "threshold_m: 0.002 #", "collision.threshold_m", "collision"),
    ("steps: 1200", "steps: 1300", "encode.visionnet.steps", "encode"),
    ("goal_db: -45.0", "goal_db: -41.0", "encode.audionet.goal_db", "encode"),
]


def test_parameters_each_of_the_stage_that_reads_it(workshop):
    for old, new, _, _ in PARAMETERS:
        workshop.edit("params.yaml", old, new)
    audit = audit_of_change(workshop)
    assert set(states(audit).values()) == {State.CHANGED}
    for object_id in IDS:
        stages = reasons_by_stage(audit, object_id)
        assert stages.pop("fidelity") == set()
        assert stages == {
            stage: {(PARAMETER, name) for _, _, name, reader in PARAMETERS if reader == stage}
            for stage in ("views", "modes", "touches", "collision", "encode")
        }


def test_parameter_says_old_and_new(workshop):
    workshop.edit("params.yaml", "accuracy_cents: 5.0", "accuracy_cents: 6.0")
    audit = audit_of_change(workshop)
    (reason,) = only(audit, "cup").roots
    assert (reason.kind, reason.name, reason.old, reason.new) == (PARAMETER, "audio.accuracy_cents", 5.0, 6.0)
    assert stages_of(audit, "cup") == ({"modes"}, {"encode", "fidelity"})
    (encode,) = (change for change in only(audit, "cup").stages if change.stage == "encode")
    assert [(consequence.kind, consequence.name) for consequence in encode.reasons] == [(UPSTREAM, "modes")]


def test_seed(workshop):
    workshop.edit("params.yaml", "\nseed: 0", "\nseed: 1")
    audit = audit_of_change(workshop)
    for object_id in IDS:
        assert told(audit, object_id) == {(SEED, "")}
        assert sentences(audit, object_id) == ["seed 0 -> 1"]


CODE_EDITS = {
    "optics": ("INDEX = 3", "INDEX = 4", "views"),
    "units": ("PASCAL = 1.0", "PASCAL = 2.0", "modes"),
    "touches": ("product(request.seed,", "product(request.seed + 1,", "touches"),
}


def test_code_of_a_task_or_of_what_it_imports(workshop):
    for module, (old, new, _) in CODE_EDITS.items():
        workshop.edit_code(module, old, new)
    stages = reasons_by_stage(audit_of_change(workshop), "dish")
    for module, (_, _, stage) in CODE_EDITS.items():
        assert stages[stage] == {(CODE, f"{PACKAGE_NAME}.{module}")}


def test_version_of_a_package(workshop, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    metadata = tmp_path / "torch-99.9.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text("Metadata-Version: 2.1\nName: torch\nVersion: 99.9\n")
    importlib.invalidate_caches()
    before = provenance_module._version("torch")
    caches = provenance_module._version, stage_module._versions
    for cache in caches:
        cache.cache_clear()
    try:
        audit = audit_of_change(workshop)
    finally:
        for cache in caches:
            cache.cache_clear()
    assert told(audit, "cup") == {(PACKAGE, "torch")}
    assert sentences(audit, "cup") == [f"package torch {before} -> 99.9"]


def test_mesh_file_that_says_the_same_in_other_bytes(workshop):
    workshop.write("cup.obj", "# exported again\nv 0 0 0\n")
    audit = audit_of_change(workshop)
    assert sentences(audit, "cup") == ["mesh changed (the file only: geometry and texture are the same)"]
    assert stages_of(audit, "cup") == ({"objects"}, set())


def test_normals_of_a_mesh():
    old, new = ({"geometry": "a", "texture": "b", "normals": digest} for digest in "cd")
    reason = _source("mesh", "x", "y", Circumstances(digests=(old, new)))
    assert (reason.kind, reason.note) == (MESH, "its normals only: geometry and texture are the same")


def test_object_removed_and_another_added(workshop):
    workshop.table.remove(workshop.row("cup"))
    workshop.add("ewer", "glass")
    audit = audit_of_change(workshop)
    assert states(audit) == {
        "cup": State.REMOVED,
        "dish": State.UNCHANGED,
        "ewer": State.ADDED,
        "spoon": State.UNCHANGED,
    }
    assert {change.object_id for change in exceeded(audit.fidelity, {"vision.psnr_db": 100.0})} == {"cup"}


def test_object_renamed(workshop):
    workshop.row("cup")["id"] = "beaker"
    workshop.save()
    audit = audit_of_change(workshop)
    assert states(audit) == {"beaker": State.RENAMED, "dish": State.UNCHANGED, "spoon": State.UNCHANGED}
    assert only(audit, "beaker").was == "cup"
    assert set(sentences(audit, "beaker")) == {"seed (drawn from the id)", "record name cup -> beaker"}


def test_object_renamed_and_changed(workshop):
    workshop.row("cup").update(id="beaker", licence="CC BY 4.0")
    workshop.save()
    audit = audit_of_change(workshop)
    assert told(audit, "beaker") == {(SEED, ""), (RECORD, "name"), (RECORD, "licence")}


def test_two_of_one_mesh_renamed_are_told_apart_by_material(workshop):
    for object_id, material in (("a", "glass"), ("b", "iron")):
        workshop.add(object_id, material, mesh=workshop.root / "cup.obj")
    before = workshop.version("two more")
    workshop.row("a")["id"], workshop.row("b")["id"] = "y", "x"
    workshop.save()
    audit = workshop.audit(before, workshop.version("renamed"))
    assert (only(audit, "x").was, only(audit, "y").was) == ("b", "a")


def test_object_failed_and_mended(workshop):
    workshop.write("cup.obj", "poison")
    failed = workshop.version("poisoned")
    audit = workshop.audit(workshop.first, failed)
    assert states(audit) == {"cup": State.FAILED, "dish": State.UNCHANGED, "spoon": State.UNCHANGED}
    assert only(audit, "cup").failure.stage == "objects"
    assert "no mesh" in only(audit, "cup").failure.error
    assert "no mesh" in only(workshop.audit(workshop.first), "cup").failure.error
    assert only(workshop.audit(failed, failed), "cup").state == State.STILL_FAILED
    workshop.write("cup.obj", "v 0 0 0\n")
    assert only(workshop.audit(failed, workshop.version("mended")), "cup").state == State.MENDED


def test_object_that_was_not_selected_did_not_fail(workshop):
    for kind in (kind for stage in workshop.stages for kind in stage.products):
        kind.path(workshop.root, "cup").unlink()
    partial = workshop.version("without the cup", make=False)
    audit = workshop.audit(workshop.first, partial)
    assert states(audit) == {"cup": State.NOT_MADE, "dish": State.UNCHANGED, "spoon": State.UNCHANGED}
    assert only(workshop.audit(partial, workshop.version("with it")), "cup").state == State.ADDED


def test_object_that_the_table_refuses(workshop):
    workshop.row("cup")["material"] = "unobtainium"
    workshop.save()
    audit = audit_of_change(workshop)
    assert only(audit, "cup").state == State.FAILED
    assert "unobtainium" in only(audit, "cup").failure.error


def test_corrupted_array(workshop):
    path = VIEWS.path(workshop.root, "cup")
    with zipfile.ZipFile(path) as archive:
        entry = archive.getinfo("values/c/0")
    data = bytearray(path.read_bytes())
    data[entry.header_offset + 30 + len(entry.filename) + 20] ^= 4
    path.write_bytes(data)
    audit = workshop.audit(workshop.first, workshop.version("corrupted", make=False))
    assert told(audit, "cup") == {(CORRUPTED, "")}
    assert "the later one" in sentences(audit, "cup")[0]
    assert states(audit)["dish"] == State.UNCHANGED


# A flipped bit of the length of a name, in an entry's mark, and of how long what follows the name is.
@pytest.mark.parametrize(("place", "changed"), [(28, False), (2, True), (31, False)])
def test_corrupted_list_of_entries(workshop, place, changed):
    first = workshop.first
    if changed:
        workshop.row("cup")["material"] = "glass"
        workshop.save()
        workshop.converge()
    path = VIEWS.path(workshop.root, "cup")
    whole = path.read_bytes()
    begin = whole.index(b"PK\1\2", whole.index(b"PK\1\2") + 4)
    flip(path, 8 * (begin + place))
    damaged = workshop.version("damaged", make=False)
    for versions, which in (((first, damaged), "later"), ((damaged, first), "earlier")):
        for arrays in (False, True):
            audit = workshop.audit(*versions, arrays=arrays)
            (views,) = (change for change in only(audit, "cup").stages if change.stage == "views")
            (reason,) = (cause for cause in views.reasons if cause.kind == CORRUPTED)
            assert f"the {which} one" in reason.note
            assert ((MATERIAL, "") in told(audit, "cup")) == changed


@pytest.mark.parametrize("kind", [VIEWS, OBJECT_FILES], ids=lambda kind: kind.name)
def test_corrupted_attributes(workshop, kind):
    path = kind.path(workshop.root, "cup")
    data = path.read_bytes()
    place = data.index(b"fingerprint") + 20  # within its digits
    path.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
    audit = workshop.audit(workshop.first, workshop.version("corrupted", make=False))
    assert {kind for kind, _ in told(audit, "cup")} <= {CORRUPTED, MISLABELLED, BYTES}
    assert any(kind in reasons.DEFECTS for kind, _ in told(audit, "cup"))


def rewritten(workshop, kind, object_id, **changes):
    """Write a product with other attributes or values than its task gave it."""
    path = kind.path(workshop.root, object_id)
    product = read_product(path)
    arrays = dict(product.arrays)
    if "values" in changes:
        before = arrays["values"]
        arrays["values"] = Array(changes["values"], before.dims, before.units, before.long_name)
    attributes = {**product.attributes, **changes.get("attributes", {})}
    path.unlink()
    write_product(path, Product(arrays, attributes))


def test_product_that_is_not_what_its_fingerprint_says(workshop):
    parts = read_product(TOUCHES.path(workshop.root, "cup")).attributes["provenance"]
    parts = json.loads(json.dumps(parts))
    parts["parameters"]["touch"]["touches"] = 7
    rewritten(workshop, TOUCHES, "cup", attributes={"provenance": parts})
    audit = workshop.audit(workshop.first, workshop.version("edited", make=False))
    assert (MISLABELLED, "") in told(audit, "cup")


def test_tolerance_declared_anew(workshop):
    attributes = read_product(VIEWS.path(workshop.root, "cup")).attributes
    tolerances = json.loads(json.dumps(as_json(STAGES["views"].tolerances)))
    tolerances["rgba"]["rms"] = 1e-3
    rewritten(
        workshop,
        VIEWS,
        "cup",
        attributes={"provenance": {**attributes["provenance"], "tolerances": tolerances}},
    )
    audit = workshop.audit(workshop.first, workshop.version("tolerance", make=False))
    assert told(audit, "cup") == {(TOLERANCE, "rgba.rms")}
    assert sentences(audit, "cup") == ["tolerance rgba.rms 1e-05 -> 0.001"]


def test_tolerances_not_stored_before(workshop):
    attributes = read_product(VIEWS.path(workshop.root, "cup")).attributes
    parts = {key: part for key, part in attributes["provenance"].items() if key != "tolerances"}
    rewritten(workshop, VIEWS, "cup", attributes={"provenance": parts})
    old = workshop.version("old", make=False)
    audit = workshop.audit(old, workshop.first)
    assert sentences(audit, "cup") == ["tolerance (stored in one of the two only)"]


def test_made_from_the_same_and_yet_of_other_values(workshop):
    values = read_product(TOUCHES.path(workshop.root, "cup"))["values"]
    rewritten(workshop, TOUCHES, "cup", values=values + 1)
    audit = workshop.audit(workshop.first, workshop.version("elsewhere", make=False))
    assert told(audit, "cup") == {(BYTES, "")}
    assert "beyond tolerance: values" in sentences(audit, "cup")[0]


def test_made_on_another_machine_within_tolerance(workshop):
    path = MODES.path(workshop.root, "cup")
    product = read_product(path)
    spread = Array(np.array([100.0, 200.0, 300.0]), ("value",), "Hz", "toy")
    path.unlink()
    write_product(path, Product({"frequencies_hz": spread}, product.attributes))
    first = workshop.version("here", make=False)
    near = Array(np.array([100.0, 200.001, 300.0]), ("value",), "Hz", "toy")
    path.unlink()
    write_product(path, Product({"frequencies_hz": near}, product.attributes))
    audit = workshop.audit(first, workshop.version("there", make=False))
    assert told(audit, "cup") == {(BYTES, "")}
    assert "1 arrays within tolerance" in sentences(audit, "cup")[0]
