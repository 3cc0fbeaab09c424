"""Objects come from their sources whole, mended and known, or not at all."""

import json
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from objectfolder.errors import FormatError, InputError
from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.surface.textured_mesh import textured_mesh_of
from pipeline.intake.sources.fetching import FETCHED, KEPT, Fetcher
from pipeline.intake.sources.recorded_hashes import ChangedError, content_of, read_hashes
from pipeline.intake.sources.registry import Resolutions
from tests.sources.served_sources import (
    GSO,
    IDS,
    POLY_HAVEN,
    SIDES_M,
    YCB,
    ServedSources,
    files_in,
    gso_members,
    poly_haven_files,
    tgz,
    ycb_members,
    zipped,
)

MESH_AND_TEXTURE = {
    IDS[0]: ("google_16k/textured.obj", "google_16k/texture_map.png"),
    IDS[1]: ("meshes/model.obj", "materials/textures/texture.png"),
    IDS[2]: (f"{POLY_HAVEN}_1k.gltf", None),
}


class Place:
    """Where objects come in a test, and the sources they come from."""

    def __init__(self, folder: Path, sources: ServedSources, base: str) -> None:
        self.folder = folder
        self.sources = sources
        self.base = base
        self.hashes = folder / "source_hashes.csv"
        self.fetched = folder / "fetched"

    def fetcher(self, **options: bool) -> Fetcher:
        return Fetcher(
            self.fetched, self.sources.downloader(self.base, self.folder / "cache"), self.hashes, **options
        )

    def fetch(self, source_id: str, resolution: str | None = None, **options: bool):
        resolutions = Resolutions([resolution] if resolution else [])
        return self.fetcher(**options).fetch(resolutions.source_object(source_id))

    def targets(self) -> list[str]:
        """Requests since the last call."""
        requests = self.sources.server.requests
        targets = [target for _, target, _ in requests]
        requests.clear()
        return targets

    def left_over(self) -> list[Path]:
        """What a fetch may not leave behind."""
        return [path for path in self.fetched.glob("*/.*") if path.suffix != ".lock"]


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    sources = ServedSources(tmp_path / "served").add_all()
    with sources.server.listening() as base:
        yield Place(tmp_path / "data", sources, base)


@pytest.mark.parametrize("source_id", IDS)
def test_an_object_comes_as_its_source_has_it(place, source_id):
    got = place.fetch(source_id)
    mesh, texture = MESH_AND_TEXTURE[source_id]
    assert got.outcome == FETCHED
    assert got.folder == place.fetched.joinpath(*source_id.split(":"))
    assert files_in(got.folder) == place.sources.expected[source_id]
    assert got.mesh == got.folder / mesh
    assert got.texture == (None if texture is None else got.folder / texture)
    assert got.recorded == len(place.sources.expected[source_id])
    assert {key[1] for key in read_hashes(place.hashes)} == set(place.sources.expected[source_id])
    said = json.loads((got.folder / "source.json").read_text(encoding="utf-8"))
    assert (said["source_id"], said["mesh"], said["texture"]) == (source_id, mesh, texture)
    assert said["licence"] in ("CC-BY-4.0", "CC0-1.0")
    assert said["attribution"]
    assert said["address"].startswith("https://")
    assert read_hashes(place.hashes)[source_id, mesh].bytes == got.mesh.stat().st_size
    assert place.left_over() == []


@pytest.mark.parametrize("source_id", IDS)
def test_what_came_can_be_ingested_with_its_colours(place, source_id):
    got = place.fetch(source_id)
    product = ingest_object(got.mesh, texture_path=got.texture, object_id="bar")
    assert product.attributes["topology"]["watertight"]
    assert product.attributes["length"]["extents_m"] == pytest.approx(SIDES_M, abs=1e-6)
    (image, *_) = textured_mesh_of(product).textures
    assert image.shape[:2] == (32, 32)


def test_the_same_colours_are_found_without_naming_the_texture(place):
    """What is named mends nothing else: mesh and mtl are the source's, and loading follows them too."""
    for source_id in IDS[:2]:
        got = place.fetch(source_id)
        named = ingest_object(got.mesh, texture_path=got.texture, object_id="bar").attributes["digests"]
        assert ingest_object(got.mesh, object_id="bar").attributes["digests"] == named


@pytest.mark.parametrize("source_id", IDS)
def test_what_is_there_is_not_fetched_again(place, source_id):
    place.fetch(source_id)
    place.targets()
    got = place.fetch(source_id)
    assert (got.outcome, got.recorded) == (KEPT, 0)
    assert place.targets() == []
    assert place.fetcher().missing(got.source_object) == []


@pytest.mark.parametrize("source_id", IDS)
def test_a_damaged_file_is_mended_from_the_cache(place, source_id):
    got = place.fetch(source_id)
    place.targets()
    got.mesh.write_bytes(b"damaged")
    assert place.fetch(source_id).outcome == FETCHED
    assert files_in(got.folder) == place.sources.expected[source_id]
    assert not [target for target in place.targets() if "/files/" not in target]


def test_hashes_lost_are_recorded_again_from_the_cache(place):
    place.fetch(IDS[0])
    before = place.hashes.read_bytes()
    place.hashes.unlink()
    got = place.fetch(IDS[0])
    assert (got.outcome, got.recorded) == (FETCHED, 4)
    assert len(place.targets()) == 1  # the rest is in the cache
    assert place.hashes.read_bytes() == before


def test_refresh_asks_anew(place):
    place.fetch(IDS[0])
    place.targets()
    assert place.fetch(IDS[0], refresh=True).outcome == FETCHED
    assert place.targets() == [f"/ycb/google/{YCB}_google_16k.tgz"]


def changed(sources: ServedSources, source_id: str) -> str:
    """Serve another texture; return the path of it in the object's folder."""
    if source_id.startswith("ycb"):
        members = ycb_members(YCB, seed=7)
        sources.write(f"ycb/google/{YCB}_google_16k.tgz", tgz(members))
        return "google_16k/texture_map.png"
    if source_id.startswith("gso"):
        sources.write(f"gso/models/{GSO}/1/{GSO}.zip", zipped(gso_members(GSO, seed=7)))
        return "materials/textures/texture.png"
    sources.add_poly_haven(POLY_HAVEN, files=poly_haven_files(POLY_HAVEN, seed=7))
    return f"textures/{POLY_HAVEN}_arm_1k.jpg"


@pytest.mark.parametrize("source_id", IDS)
def test_changed_content_is_refused_by_both_hashes_until_it_is_accepted(place, source_id):
    before = place.fetch(source_id)
    path = changed(place.sources, source_id)
    with pytest.raises(ChangedError) as caught:
        place.fetch(source_id, refresh=True)
    old = read_hashes(place.hashes)[source_id, path]
    assert f"{source_id} {path}" == caught.value.where
    assert old.sha256 in caught.value.finding
    assert f"objectfolder fetch {source_id} --accept-changed" in caught.value.remedy
    assert place.fetch(source_id).outcome == KEPT
    assert place.left_over() == []
    assert files_in(before.folder)[path] != b""

    accepted = place.fetch(source_id, accept_changed=True)
    new = read_hashes(place.hashes)[source_id, path]
    assert new.sha256 != old.sha256
    assert new.sha256 in caught.value.finding
    assert content_of(accepted.folder / path) == new


@pytest.mark.parametrize("source_id", IDS)
def test_content_that_others_know_otherwise_is_refused_on_the_first_fetch(place, source_id):
    got = place.fetch(source_id)
    path = changed(place.sources, source_id)
    elsewhere = Place(place.folder / "elsewhere", place.sources, place.base)
    elsewhere.hashes = place.hashes
    with pytest.raises(ChangedError, match=r"sha256 [0-9a-f]{64} .* recorded is [0-9a-f]{64}"):
        elsewhere.fetch(source_id)
    assert not (elsewhere.fetched.joinpath(*source_id.split(":"))).exists()
    assert elsewhere.left_over() == []
    assert content_of(got.folder / path) == read_hashes(place.hashes)[source_id, path]


def test_an_archive_packed_again_with_the_same_files_is_the_same(place):
    place.fetch(IDS[0])
    members = dict(reversed(ycb_members(YCB).items()))
    place.sources.write(f"ycb/google/{YCB}_google_16k.tgz", tgz(members))
    assert place.fetch(IDS[0], refresh=True).recorded == 0


def test_another_resolution_comes_beside_the_first(place):
    place.sources.add_poly_haven(POLY_HAVEN, "2k")
    place.sources.add_ycb(YCB, "google_64k")
    for source_id, resolution, mesh in (
        (IDS[2], "2k", f"{POLY_HAVEN}_2k.gltf"),
        (IDS[0], "ycb=google_64k", "google_64k/textured.obj"),
    ):
        first = place.fetch(source_id)
        second = place.fetch(source_id, resolution)
        assert second.mesh == second.folder / mesh
        assert files_in(second.folder) == place.sources.expected[source_id]
        place.targets()
        assert place.fetch(source_id).mesh == first.mesh
        assert place.fetch(source_id, resolution).outcome == KEPT
        assert place.targets() == []


def test_what_is_known_otherwise_of_one_resolution_does_not_touch_another(place):
    place.sources.add_poly_haven(POLY_HAVEN, "2k")
    place.fetch(IDS[2], "2k")
    first = place.fetch(IDS[2])
    text = place.hashes.read_text(encoding="utf-8")
    place.hashes.write_text(
        text.replace(f"textures/{POLY_HAVEN}_arm_2k.jpg,", f"textures/{POLY_HAVEN}_arm_2k.jpg,1")
    )
    assert place.fetch(IDS[2]).outcome == KEPT
    with pytest.raises(ChangedError):
        place.fetch(IDS[2], "2k")
    assert place.fetch(IDS[2]).mesh == first.mesh


@pytest.mark.parametrize(
    ("source_id", "finding", "remedy"),
    [
        ("ycb:901_test_ber", "YCB Object and Model Set has no such object", "Did you mean ycb:901_test_bar?"),
        ("ycb:Test_Bar", "no such object", "Did you mean ycb:901_test_bar?"),
        ("polyhaven:test_bar_01", "Poly Haven has no such object", "Did you mean polyhaven:Test_Bar_01?"),
        ("gso:Cafe_Bar_16 oz_cup", "no such object", f"Did you mean gso:{GSO}?"),
        ("gso:Xylophone", "no such object", "`objectfolder fetch --list gso` prints its 1 names"),
        ("ycb:../elsewhere", "has '/' in it", "Copy the name"),
        ("ycb:", "'' is no name", "Copy the name"),
        ("gso:" + "é" * 150, "File name too long", ""),
        ("polyhaven:Télé", "is not a slug", "Copy the end of the address"),
        ("polyheaven:Television_01", "no such source", "Did you mean polyhaven?"),
        ("025_mug", "does not say of which source it is", "Write it as ycb:025_mug"),
    ],
)  # fmt: skip
def test_an_unknown_object_is_answered_with_what_to_do(place, source_id, finding, remedy):
    with pytest.raises(InputError) as caught:
        place.fetch(source_id)
    assert finding in caught.value.finding
    assert remedy in caught.value.remedy
    assert not list(place.fetched.glob("*/[!.]*"))
    assert place.left_over() == []


@pytest.mark.parametrize("status", ["404", "403"])
def test_a_listed_object_that_google_did_not_scan_says_what_there_is(place, status):
    """The bucket answers 404 or, where it may not be listed, 403."""
    place.sources.ycb_names.append("072-f_toy_airplane")
    place.sources.write_lists()
    place.sources.server.plan = lambda path: status if "072-f" in path else ""
    with pytest.raises(InputError) as caught:
        place.fetch("ycb:072-f_toy_airplane")
    assert "has no google_16k of it" in caught.value.finding
    assert "berkeley/072-f_toy_airplane/072-f_toy_airplane_berkeley_meshes.tgz" in caught.value.remedy


def test_an_absent_object_of_a_source_without_a_list_is_told(place):
    place.sources.server.documents.clear()
    (place.sources.folder / "ycb/objects.json").unlink()
    for source_id in ("ycb:902_none", "gso:None", "polyhaven:None"):
        with pytest.raises(InputError, match="the source's list cannot be fetched"):
            place.fetch(source_id)


def test_unknown_resolutions_are_refused_with_those_there_are(place):
    with pytest.raises(InputError, match="ycb: google_16k, google_64k, google_512k"):
        Resolutions(["3k"])
    with pytest.raises(InputError, match="There are gso: original"):
        Resolutions(["gso=1k"])
    with pytest.raises(InputError, match=r"has no glTF of 8k\. It has 1k"):
        place.fetch(IDS[2], "8k")


def test_lists_are_read_to_their_end(place):
    for number in range(4):
        place.sources.add_gso(f"Bar_{number}")
    source = Resolutions().source_object(IDS[1]).source
    fetcher = place.fetcher()
    place.targets()
    assert fetcher.names(source) == ["Bar_0", "Bar_1", "Bar_2", "Bar_3", GSO]
    assert place.targets() == [f"/gso/models?page={page}&per_page=100" for page in (1, 2, 3, 4)]
    fetcher.names(source)
    assert place.targets() == []


def test_a_list_whose_last_page_repeats_ends(place):
    pages = place.sources.server.documents
    pages["/gso/models?page=2&per_page=100"] = pages["/gso/models?page=1&per_page=100"]
    assert place.fetcher().names(Resolutions().source_object(IDS[1]).source) == [GSO]


@pytest.mark.parametrize(
    "answer", [b"[]", b"{}", b"null", b'{"objects": 3}', b'{"objects": [1]}', b"[[[", b"3"]
)
def test_lists_that_are_none_are_refused(place, answer):
    place.sources.write("ycb/objects.json", answer)
    place.sources.server.documents |= {
        "/polyhaven/assets?type=models": answer,
        "/gso/models?page=1&per_page=100": b"{}" if answer.startswith(b"[]") else answer,
    }
    for source_id in IDS:
        with pytest.raises(FormatError):
            place.fetcher().names(Resolutions().source_object(source_id).source)


HOSTILE = {
    "a path that leads out": {"../../out.jpg": {}},
    "an absolute path": {"/elsewhere/out.jpg": {}},
    "a path of another system": {"textures\\out.jpg": {}},
    "a path that is not plain": {"textures//out.jpg": {}},
    "another host": {"a.jpg": {"url": "https://example.org/a.jpg"}},
    "a host that ends alike": {"a.jpg": {"url": "https://notpolyhaven.org/a.jpg"}},
    "a file of this machine": {"a.jpg": {"url": "file:///etc/passwd"}},
    "names that differ by case": {"a.jpg": {}, "A.jpg": {}},
    "a size that is none": {"a.jpg": {"size": "3"}},
    "an md5 that is none": {"a.jpg": {"md5": "abc"}},
    "no address": {"a.jpg": {"url": None}},
    "its record": {"source.json": {}},
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_list_of_files_that_leads_elsewhere_is_refused(place, what):
    (main,) = place.sources.slugs[POLY_HAVEN]["1k"].values()
    plain = dict(main["include"][f"{POLY_HAVEN}.bin"])
    main["include"] |= {path: {**plain, **entry} for path, entry in HOSTILE[what].items()}
    place.sources.write_lists()
    with pytest.raises(FormatError):
        place.fetch(IDS[2])
    assert not (place.fetched / "polyhaven" / POLY_HAVEN).exists()
    assert [path for path in place.folder.rglob("out.jpg")] == []


@pytest.mark.parametrize(
    "answer", [b"{}", b"[]", b"3", b'{"gltf": []}', b'{"gltf": {"1k": {}}}', b'{"gltf": {"1k": 3}}']
)
def test_an_answer_that_is_no_list_of_files_is_refused(place, answer):
    place.sources.server.documents[f"/polyhaven/files/{POLY_HAVEN}"] = answer
    with pytest.raises((FormatError, InputError)):
        place.fetch(IDS[2])


def test_a_gltf_that_names_what_is_not_listed_is_refused(place):
    (main,) = place.sources.slugs[POLY_HAVEN]["1k"].values()
    del main["include"][f"{POLY_HAVEN}.bin"]
    place.sources.write_lists()
    with pytest.raises(FormatError, match=r"names 'Test_Bar_01\.bin', which its list of files does not have"):
        place.fetch(IDS[2])


@pytest.mark.parametrize(
    ("members", "finding"),
    [
        ({}, "it holds no file"),
        ({"another/google_16k/textured.obj": b"v 0 0 0"}, "holds none of the wanted files in 901_test_bar/"),
        ({f"{YCB}/google_16k/other.obj": b"v 0 0 0"}, "not among the downloaded files"),
        ({f"{YCB}/google_16k/textured.obj": b"mtllib none.mtl\n"}, "names the material library 'none.mtl'"),
        ({f"{YCB}/source.json.txt": b"", f"{YCB}/source.json": b"{}"}, "not among the downloaded files"),
    ],
)  # fmt: skip
def test_an_archive_laid_out_otherwise_is_refused(place, members, finding):
    place.sources.write(f"ycb/google/{YCB}_google_16k.tgz", tgz(members))
    with pytest.raises(FormatError, match=finding):
        place.fetch(IDS[0])
    assert not (place.fetched / "ycb" / YCB).exists()
    assert place.left_over() == []


def test_an_archive_with_a_record_of_its_own_is_refused(place):
    place.sources.write(f"gso/models/{GSO}/1/{GSO}.zip", zipped(gso_members(GSO) | {"source.json": b"{}"}))
    with pytest.raises(FormatError, match=r"has a file 'source\.json' of its own"):
        place.fetch(IDS[1])


def test_an_image_outside_the_folder_is_not_taken(place):
    members = ycb_members(YCB)
    outside = place.folder / "outside.png"
    outside.parent.mkdir(parents=True)
    outside.write_bytes(members[f"{YCB}/google_16k/texture_map.png"])
    members[f"{YCB}/google_16k/textured.mtl"] = f"newmtl m\nmap_Kd {outside}\n".encode()
    place.sources.write(f"ycb/google/{YCB}_google_16k.tgz", tgz(members))
    with pytest.raises(FormatError):
        place.fetch(IDS[0])


def test_a_damaged_archive_is_asked_for_once_more(place):
    place.sources.server.plan = lambda path, left=["truncated"]: (
        left.pop() if path.endswith(".zip") and left else ""
    )
    got = place.fetch(IDS[1])
    assert files_in(got.folder) == place.sources.expected[IDS[1]]
    assert len([target for target in place.targets() if target.endswith(".zip")]) == 2


def test_an_archive_that_stays_damaged_is_refused(place):
    place.sources.write(f"ycb/google/{YCB}_google_16k.tgz", tgz(ycb_members(YCB))[:-200])
    with pytest.raises(FormatError):
        place.fetch(IDS[0])
    assert place.left_over() == []


def test_two_that_fetch_the_same_at_once_both_have_it(place):
    outcomes = []
    threads = [
        threading.Thread(target=lambda: outcomes.append(place.fetch(IDS[1]).outcome)) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(outcomes) == sorted([FETCHED, KEPT, KEPT, KEPT])
    assert place.left_over() == []


def test_what_was_being_replaced_when_killed_comes_from_the_cache(place):
    got = place.fetch(IDS[0])
    shutil.rmtree(got.folder)
    (got.folder.with_name(f".{YCB}.partial") / "half").mkdir(parents=True)
    place.targets()
    assert place.fetch(IDS[0]).outcome == FETCHED
    assert place.targets() == []
    assert place.left_over() == []
