"""Verification of a version: every flipped bit is found, told of the right file, with what to do."""

import json
import os
import random
import shutil
import zipfile

import pytest
from versions_of_workshop import flip, made_versions

from objectfolder.products.store import Array, Product, read_product, write_product
from objectfolder.products.tensor_file import read_tensor_file, write_tensor_file
from pipeline.audit.contents import Contents
from pipeline.audit.reasons import CORRUPTED
from pipeline.audit.reasons import MISLABELLED as SAYS_ANOTHER
from pipeline.audit.recomputation import FAILED, recompute
from pipeline.audit.reproducibility import DIFFERENT, EQUAL
from pipeline.audit.verification import (  # fmt: skip
    DAMAGED,
    MADE_FROM_ANOTHER,
    MISLABELLED,
    MISSING,
    OTHER,
    UNLISTED,
    verify,
)
from pipeline.dataset.stages import FIDELITY, MODES, OBJECT_FILES, STAGES, TOUCHES, VIEWS


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    with made_versions(
        tmp_path_factory.mktemp("verify"), "workshop_of_verify", cup="steel", dish="wood"
    ) as workshop:
        yield workshop


@pytest.fixture
def workshop(made):
    made.restore()
    return made


def found_in(workshop, revision=None):
    with Contents(workshop.root) as contents:
        return verify(contents, workshop.at(contents, revision), workshop.stages)


def told(workshop, revision=None):
    return {(finding.where, finding.kind) for finding in found_in(workshop, revision).findings}


def bit_of_a_chunk(path):
    with zipfile.ZipFile(path) as archive:
        entry = archive.getinfo("values/c/0")
    return 8 * (entry.header_offset + 30 + len(entry.filename) + 20)


def product_files(workshop):
    return [path for name in workshop.products() if (path := workshop.root / name)]


def test_nothing_wrong(workshop):
    for revision in (None, "HEAD"):
        report = found_in(workshop, revision)
        assert report.findings == ()
        assert report.files == 2 * 8 + 8  # products, and the lists of their folders
        assert report.bytes > sum(path.stat().st_size for path in product_files(workshop))


@pytest.mark.slow
def test_every_one_of_forty_flipped_bits_is_found(made):
    made.restore()
    files = product_files(made)
    with Contents(made.root) as contents:
        commit = made.at(contents, "HEAD")
        for seed in range(40):
            draw = random.Random(seed)
            path = draw.choice(files)
            in_cache = bool(seed % 2)
            place = made.in_cache(path) if in_cache else path
            whole = place.read_bytes()
            flip(place, draw.randrange(8 * len(whole)))
            version = commit if in_cache else made.at(contents, None)
            findings = verify(contents, version, made.stages).findings
            place.write_bytes(whole)
            wheres = {finding.where for finding in findings}
            assert wheres == {path.relative_to(made.root).as_posix()}, (seed, findings)
            assert all(finding.remedy for finding in findings)
    assert told(made) == told(made, "HEAD") == set()


@pytest.mark.slow
def test_every_flipped_bit_of_a_real_object_file_is_found_without_any_list(made, small_file):
    made.restore()
    shutil.copy(small_file, OBJECT_FILES.path(made.root, "cup"))
    (made.root / "dvc.lock").unlink()
    where = "data/object_files/cup.safetensors"
    whole = small_file.read_bytes()
    # Made by no stage: it says so, and opens.
    with Contents(made.root) as contents:
        version = made.at(contents, None)
        assert DAMAGED not in {
            finding.kind
            for finding in verify(contents, version, made.stages).findings
            if finding.where == where
        }
        for seed in range(20):
            flip(made.root / where, random.Random(seed).randrange(8 * len(whole)))
            defects = {
                (finding.where, finding.kind) for finding in verify(contents, version, made.stages).findings
            }
            assert (where, DAMAGED) in defects
            (made.root / where).write_bytes(whole)


def test_damage_is_told_apart_from_another_whole_content(workshop):
    flip(VIEWS.path(workshop.root, "cup"), bit_of_a_chunk(VIEWS.path(workshop.root, "cup")))
    attributes = read_product(MODES.path(workshop.root, "dish"))
    MODES.path(workshop.root, "dish").unlink()
    write_product(MODES.path(workshop.root, "dish"), attributes.with_attributes(note="edited"))
    assert told(workshop) == {
        ("data/views/cup.zarr.zip", DAMAGED), ("data/modes/dish.zarr.zip", OTHER),
    }  # fmt: skip


def test_remedy_names_where_a_good_copy_is(workshop):
    path = VIEWS.path(workshop.root, "cup")
    cached = workshop.in_cache(path)
    flip(path, bit_of_a_chunk(path))
    (finding,) = found_in(workshop).findings
    assert finding.remedy == "The cache has it: delete the file, then `dvc checkout data/views`."
    flip(cached, 8 * 100)
    (finding,) = found_in(workshop).findings
    assert "in the cache is damaged, too" in finding.remedy


def test_link_into_a_damaged_cache(workshop):
    path = VIEWS.path(workshop.root, "cup")
    cached = workshop.in_cache(path)
    path.unlink()
    os.link(cached, path)
    bit = bit_of_a_chunk(path)
    data = bytearray(path.read_bytes())
    data[bit // 8] ^= 1
    path.write_bytes(data)
    (finding,) = found_in(workshop).findings
    assert (finding.where, finding.kind) == ("data/views/cup.zarr.zip", DAMAGED)
    assert "damaged, too" in finding.remedy


def test_file_missing_and_file_too_many(workshop):
    path = VIEWS.path(workshop.root, "cup")
    path.rename(path.with_name("beaker.zarr.zip"))
    assert {("data/views/cup.zarr.zip", MISSING), ("data/views/beaker.zarr.zip", UNLISTED)} <= told(workshop)


def test_folder_that_was_never_checked_out(workshop):
    shutil.rmtree(workshop.root / "data/views")
    findings = found_in(workshop).findings
    assert [(finding.where, finding.kind) for finding in findings] == [("data/views", MISSING)]
    assert "dvc checkout data/views" in findings[0].remedy


def test_list_of_a_folder_damaged_in_the_cache(workshop):
    (listing,) = (
        path
        for path in (workshop.root / ".dvc/cache").rglob("*.dir")
        if b"cup.zarr.zip" in path.read_bytes() and workshop.in_cache(VIEWS.path(workshop.root, "cup"))
        .relative_to(workshop.root / ".dvc/cache/files/md5").as_posix().replace("/", "").encode()
        in path.read_bytes()
    )  # fmt: skip
    flip(listing, 8 * 4 + 1)
    assert any("data/views" in where for where, _ in told(workshop))


def test_content_that_is_nowhere(workshop):
    workshop.in_cache(VIEWS.path(workshop.root, "cup")).unlink()
    (finding,) = found_in(workshop, "HEAD").findings
    assert (finding.where, finding.kind) == ("data/views/cup.zarr.zip", MISSING)


def test_product_whose_parts_were_edited(workshop):
    path = OBJECT_FILES.path(workshop.root, "cup")
    content = read_tensor_file(path)
    parts = json.loads(content.metadata["provenance"])
    parts["record"]["licence"] = "mine"
    path.unlink()
    write_tensor_file(path, content.with_metadata(provenance=parts))
    workshop.version("edited", make=False)
    assert told(workshop) == told(workshop, "HEAD") == {("data/object_files/cup.safetensors", MISLABELLED)}


def test_product_made_from_another_than_lies_beside_it(workshop):
    before = VIEWS.path(workshop.root, "cup").read_bytes()
    workshop.edit("params.yaml", "    vision:\n      resolution: 128", "    vision:\n      resolution: 64")
    workshop.version("smaller")
    VIEWS.path(workshop.root, "cup").write_bytes(before)
    workshop.version("mixed", make=False)
    assert told(workshop, "HEAD") == {
        ("data/encoded/cup.safetensors", MADE_FROM_ANOTHER),
        ("data/fidelity/cup.zarr.zip", MADE_FROM_ANOTHER),
        ("data/object_files/cup.safetensors", MADE_FROM_ANOTHER),
    }


def test_hostile_archives(workshop):
    bomb, twice = VIEWS.path(workshop.root, "cup"), MODES.path(workshop.root, "cup")
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("zarr.json", b"[" * 50_000_000)
    with zipfile.ZipFile(twice, "w") as archive:
        archive.writestr("../../escaped", b"x")
        archive.writestr("zarr.json", b'{"attributes": {}, "zarr_format": 3, "node_type": "group"}')
    deep = TOUCHES.path(workshop.root, "cup")
    with zipfile.ZipFile(deep, "w") as archive:
        archive.writestr("zarr.json", b'{"attributes": ' + b'{"a": ' * 200_000 + b"1" + b"}" * 200_001)
    assert {(f"data/{name}/cup.zarr.zip", DAMAGED) for name in ("views", "modes", "touches")} == {
        defect for defect in told(workshop) if defect[1] == DAMAGED
    }
    audit = workshop.audit("HEAD")
    defects = {
        (stage.stage, reason.kind)
        for change in audit.objects
        for stage in change.stages
        for reason in stage.reasons
    }
    # The second one's attributes can be read; they do not say what it was made from.
    assert defects == {("views", CORRUPTED), ("modes", SAYS_ANOTHER), ("touches", CORRUPTED)}


@pytest.fixture
def children_find_the_bodies(workshop, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(workshop.root), os.environ.get("PYTHONPATH", "")]))


def remade(workshop, *names, revision=None):
    """Make products of some stages again."""
    stages = [stage for stage in workshop.stages if stage.name in names]
    with Contents(workshop.root) as contents:
        results = recompute(contents, workshop.at(contents, revision), stages, 14, seed=0)
    return {(result.stage, result.object_id): result for result in results}


@pytest.mark.slow
@pytest.mark.usefixtures("children_find_the_bodies")
def test_products_of_an_older_version_made_again_from_its_own_records(workshop):
    workshop.edit("data/materials.csv", "wood,750,", "wood,760,")
    workshop.version("second")
    results = remade(workshop, "objects", "modes", revision=workshop.first)
    modes = results["modes", "dish"]
    assert modes.verdict == EQUAL
    # Meshes of the toys are versioned by neither git's outputs nor DVC's: that is said, not guessed.
    assert results["objects", "dish"].verdict == FAILED


@pytest.mark.slow
@pytest.mark.usefixtures("children_find_the_bodies")
def test_products_made_again_are_equal_but_for_one_that_nobody_could_have_made(workshop):
    path = FIDELITY.path(workshop.root, "cup")
    product = read_product(path)
    values = product.arrays["values"]
    path.unlink()
    forged = Array(values.data + 1, values.dims, values.units, values.long_name)
    write_product(path, Product({"values": forged}, product.attributes))
    before = workshop.products()
    results = remade(workshop, *STAGES)
    assert len(results) == 2 * 7
    assert results["fidelity", "cup"].verdict == DIFFERENT, results["fidelity", "cup"].finding
    assert "values" in results["fidelity", "cup"].finding
    assert {key for key, result in results.items() if result.verdict != EQUAL} == {("fidelity", "cup")}
    assert {key for key, result in results.items() if result.finding} == {("fidelity", "cup")}
    assert workshop.products() == before


@pytest.mark.slow
@pytest.mark.usefixtures("children_find_the_bodies")
def test_code_of_today_that_is_another_is_said(workshop):
    workshop.edit_code("units", "PASCAL = 1.0", "PASCAL = 2.0")
    result = remade(workshop, "modes")["modes", "cup"]
    assert result.verdict == DIFFERENT
    assert "code workshop_of_verify.units changed" in result.finding


@pytest.mark.parametrize("seed", [None, "7", True, 0.5])
def test_product_that_names_no_seed_is_not_made_with_another(workshop, seed):
    path = TOUCHES.path(workshop.root, "cup")
    product = read_product(path)
    parts = {key: part for key, part in product.attributes["provenance"].items() if key != "seed"}
    path.unlink()
    write_product(
        path, product.with_attributes(provenance=parts if seed is None else {**parts, "seed": seed})
    )
    (stage,) = (candidate for candidate in workshop.stages if candidate.name == "touches")
    with Contents(workshop.root) as contents:
        results = {
            result.object_id: result
            for result in recompute(contents, workshop.at(contents, None), [stage], 2, 0)
        }
    assert results["cup"].verdict == FAILED
    assert "data/touches/cup.zarr.zip: its seed" in results["cup"].finding


def test_draw_is_of_its_seed(workshop, monkeypatch):
    draws = []
    monkeypatch.setattr(
        "pipeline.audit.recomputation._Bench.remake",
        lambda self, stage, object_id, child: draws.append((stage.name, object_id)),
    )
    for seed in (1, 1, 2):
        with Contents(workshop.root) as contents:
            recompute(contents, workshop.at(contents, None), workshop.stages, 3, seed)
    assert draws[:3] == draws[3:6] != draws[6:]
    assert len(set(draws[:3])) == 3
