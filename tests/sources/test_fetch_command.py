"""`objectfolder fetch` as a user types it."""

import csv
import io
import json
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pipeline.cli import main
from pipeline.dataset.catalogue import read_catalogue, read_rows
from pipeline.intake.sources.http_client import USER_AGENT
from pipeline.intake.sources.registry import Resolutions
from tests.conftest import REPOSITORY
from tests.sources.served_sources import GSO, IDS, POLY_HAVEN, YCB, ServedSources, files_in

TABLE = f"""id,mesh,texture,material,source_id
bar,fetched/ycb/{YCB}/google_16k/textured.obj,fetched/ycb/{YCB}/google_16k/texture_map.png,steel,ycb:{YCB}
cup,fetched/gso/{GSO}/meshes/model.obj,,ceramic,gso:{GSO}
own,own.obj,,steel,
piece,fetched/polyhaven/{POLY_HAVEN}/{POLY_HAVEN}_1k.gltf,,steel,polyhaven:{POLY_HAVEN}
again,fetched/polyhaven/{POLY_HAVEN}/another.gltf,,steel,polyhaven:{POLY_HAVEN}
"""
Fetch = Callable[..., tuple[int, str, str]]


@pytest.fixture
def sources(tmp_path: Path) -> ServedSources:
    return ServedSources(tmp_path / "served").add_all()


@pytest.fixture
def fetch(
    sources: ServedSources,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Iterator[Fetch]:
    """Run the command in a folder of its own; return status, what it printed, and its errors."""
    place = tmp_path / "place"
    (place / "data").mkdir(parents=True)
    monkeypatch.chdir(place)

    def run(*words: str) -> tuple[int, str, str]:
        status = main(["fetch", *words, "--retries", "1"])
        return status, *capsys.readouterr()

    with sources.server.listening() as base:
        monkeypatch.setenv("OBJECTFOLDER_MIRRORS", " ".join(sources.mirrors(base)))
        yield run


def test_ids_come_to_data_fetched_with_rows_to_add(fetch, sources):
    status, said, errors = fetch(*IDS)
    assert (status, errors) == (0, "")
    for source_id in IDS:
        assert files_in(Path("data/fetched", *source_id.split(":"))) == sources.expected[source_id]
    assert f"mesh     data/fetched/ycb/{YCB}/google_16k/textured.obj" in said
    assert f"texture  data/fetched/gso/{GSO}/materials/textures/texture.png" in said
    assert "texture  named by the mesh" in said
    assert "licence  CC-BY-4.0; Google Scanned Objects, Copyright 2020 Google LLC" in said
    assert "3 of 3 are there" in said
    assert Path("data/source_hashes.csv").is_file()

    text = said[said.index("id,name,") : said.index("3 of 3")]
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [row["source_id"] for row in rows] == list(IDS)
    for row in rows:
        row["material"] = "steel"
    with Path("data/objects.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    catalogue = read_catalogue(Path("data/objects.csv"), ["steel"])
    assert catalogue.errors == {}
    assert [record.id for record in catalogue.records] == [YCB, "Caf__Bar_16_oz_cup", POLY_HAVEN]


@pytest.mark.release("docs", "pipeline.intake", "pipeline.cli")
def test_the_page_of_collections_runs(fetch):
    """Of other objects: `served_sources` has three."""
    Path("data/objects.csv").write_text(TABLE, encoding="utf-8")
    page = (REPOSITORY / "docs" / "sources.md").read_text(encoding="utf-8")
    queries = re.findall(r"^objectfolder fetch ([^#\n]*)", page, re.MULTILINE)
    served = {source_id.partition(":")[0]: source_id for source_id in IDS}
    rows = {"025_mug": "bar", "024_bowl": "cup"}
    assert len(queries) >= 4
    for query in queries:
        words = [
            served[word.partition(":")[0]] if ":" in word else rows.get(word, word) for word in query.split()
        ]
        status, _, errors = fetch(*words)
        assert status == 0, (query, errors)


def test_a_table_is_fetched_where_it_expects_its_files(fetch, sources):
    Path("data/objects.csv").write_text(TABLE, encoding="utf-8")
    Path("data/own.obj").write_text("v 0 0 0\n")
    status, said, _ = fetch("--table", "data/objects.csv")
    assert status == 0
    assert "3 of 3 are there" in said
    assert "each to be given its material" not in said
    errors_of_table = read_catalogue(Path("data/objects.csv"), ["steel", "ceramic"]).errors
    assert list(errors_of_table) == ["again"]


def test_a_table_of_another_folder_takes_its_own_place(fetch):
    Path("elsewhere").mkdir()
    Path("elsewhere/my.csv").write_text(TABLE, encoding="utf-8")
    status, said, _ = fetch("--table", "elsewhere/my.csv", "--only", "cup")
    assert status == 0
    assert Path("elsewhere/fetched/gso", GSO, "source.json").is_file()
    assert Path("elsewhere/source_hashes.csv").is_file()
    assert said.count("fetched, ") == 1


def test_one_that_fails_does_not_stop_the_others(fetch, sources):
    status, said, errors = fetch("ycb:none", IDS[0], "gso:none", "bar", IDS[2])
    assert status == 1
    assert "2 of 5 are there" in said
    assert "3 of 5 failed" in errors
    summary = errors[errors.index("3 of 5 failed") :]
    for source_id in ("ycb:none", "gso:none", "bar"):
        assert f"  {source_id}: " in summary
    status, said, errors = fetch(IDS[0], IDS[2])
    assert (status, errors) == (0, "")
    assert said.count("already there") == 2
    _, said, _ = fetch(IDS[0], IDS[2], "--json")
    figures = [(entry["id"], entry["outcome"], Path(entry["mesh"]).is_file()) for entry in json.loads(said)]
    assert figures == [(IDS[0], "already there", True), (IDS[2], "already there", True)]
    _, said, _ = fetch(IDS[0], IDS[1], "--dry-run", "--json")
    assert {entry["id"] for entry in json.loads(said)} == {IDS[1]}


def test_a_source_that_cannot_be_reached_is_not_waited_for_forever(fetch, sources, monkeypatch):
    monkeypatch.setenv("OBJECTFOLDER_MIRRORS", "ycb=http://127.0.0.1:9/")
    names = [f"ycb:{number}" for number in range(6)]
    status, _, errors = fetch(*names)
    assert status == 1
    assert errors.count("cannot be fetched: its server refuses connections") == 4  # two, told twice
    assert errors.count("not tried, for its source cannot be reached") == 8


def test_the_list_of_a_source_is_its_ids(fetch):
    assert fetch("--list", "ycb") == (0, f"{IDS[0]}\n", "")
    assert fetch("--list", "gso") == (0, f"{IDS[1]}\n", "")
    assert fetch("--list", "polyhaven") == (0, f"{IDS[2]}\n", "")


def test_a_dry_run_tells_addresses_and_sizes_and_fetches_nothing(fetch, sources):
    status, said, errors = fetch("--dry-run", *IDS)
    assert (status, errors) == (0, "")
    assert f"https://ycb-benchmarks.s3.amazonaws.com/data/google/{YCB}_google_16k.tgz  size unknown" in said
    assert "https://fuel.gazebosim.org/1.0/GoogleResearch/models/Caf%C3%A9_Bar_16%20oz_cup/1/" in said
    assert f"https://dl.polyhaven.org/file/ph-assets/Models/gltf/8k/{POLY_HAVEN}/{POLY_HAVEN}.bin" in said
    assert "2 files of unknown size" in said
    assert not Path("data/fetched").exists()
    assert {target for _, target, _ in sources.server.requests} == {f"/polyhaven/files/{POLY_HAVEN}"}
    fetch(IDS[0])
    assert f"{IDS[0]}  already there" in fetch("--dry-run", IDS[0])[1]
    assert fetch("--dry-run", "polyhaven:none")[0] == 1


def test_options_choose_folder_cache_hashes_resolution_and_mirror(fetch, sources, monkeypatch):
    sources.add_poly_haven(POLY_HAVEN, "2k")
    mirror = os.environ["OBJECTFOLDER_MIRRORS"].split()[2]
    monkeypatch.delenv("OBJECTFOLDER_MIRRORS")
    words = ["--folder", "there", "--cache", "kept", "--hashes", "known.csv", "--resolution", "polyhaven=2k"]
    status, said, _ = fetch(IDS[2], *words, "--mirror", mirror)
    assert status == 0
    assert f"there/polyhaven/{POLY_HAVEN}/{POLY_HAVEN}_2k.gltf" in said
    assert Path("known.csv").is_file()
    assert any(Path("kept").rglob("*.jpg"))
    assert not Path("data/fetched").exists()


def test_a_proxy_is_asked_for_everything(fetch, sources):
    """The local server stands in for the proxy: it sees whole addresses."""
    base = os.environ["OBJECTFOLDER_MIRRORS"].split()[0].partition("=")[2].removesuffix("/ycb")
    status, _, errors = fetch(IDS[0], "--mirror", "ycb=http://mirror.invalid/ycb", "--proxy", base)
    assert (status, errors) == (0, "")
    assert [target for _, target, _ in sources.server.requests] == [
        f"http://mirror.invalid/ycb/google/{YCB}_google_16k.tgz"
    ]


# Wrong usage; the others name a source or a table that there is not.
OF_OPTIONS = (
    "names no objects, or in several ways",
    "--only: chooses from a table",
    "no such resolution",
    "--retries: -1",
)


@pytest.mark.parametrize(
    ("words", "finding"),
    [
        ([], "names no objects, or in several ways"),
        (["ycb:a", "--list", "ycb"], "names no objects, or in several ways"),
        (["ycb:a", "--table", "data/objects.csv"], "names no objects, or in several ways"),
        (["--list", "yc"], "no such source. Did you mean ycb?"),
        (["--table", "none.csv"], "the table of objects does not exist"),
        (["--only", "cup"], "names no objects, or in several ways"),
        (["ycb:a", "--only", "cup"], "--only: chooses from a table"),
        (["ycb:a", "--mirror", "ycb"], "is not of the form SOURCE=http://..."),
        (["ycb:a", "--mirror", "yc=http://localhost"], "no such source"),
        (["ycb:a", "--mirror", "ycb=ftp://localhost"], "is not of the form SOURCE=http://..."),
        (["ycb:a", "--resolution", "7k"], "no such resolution"),
        (["ycb:a", "--retries", "-1"], "--retries: -1"),
    ],
)  # fmt: skip
def test_words_that_mean_nothing_are_refused(fetch, sources, words, finding, capsys):
    status = main(["fetch", *words])
    assert status == (2 if finding in OF_OPTIONS else 1)
    assert finding in capsys.readouterr().err
    assert sources.server.requests == []


@pytest.mark.parametrize(
    ("text", "only", "finding"),
    [
        ("id,mesh,material\na,b,c\n", [], "has no column 'source_id'"),
        ("mesh,material\na,b\n", [], "has no column 'id'"),
        (TABLE, ["cups"], "there is no object 'cups'. Did you mean cup?"),
        (TABLE, ["own"], "has no source_id"),
        ("id,source_id\n\xff", [], None),
    ],
)
def test_tables_that_name_nothing_to_fetch_are_refused(fetch, text, only, finding):
    Path("data/objects.csv").write_bytes(text.encode("latin-1" if finding is None else "utf-8"))
    status, _, errors = fetch("--table", "data/objects.csv", *(["--only", *only] if only else []))
    assert status == 1
    assert (finding or "is not a CSV table in UTF-8") in errors


def test_every_source_names_the_software_it_is_asked_by(fetch, sources):
    fetch(*IDS)
    assert {headers["user-agent"] for _, _, headers in sources.server.requests} == {USER_AGENT}


def test_the_papers_table_names_what_its_sources_lay_out():
    """Mesh and texture of each row are those that its source's module would find, at a known resolution."""
    _, rows = read_rows(REPOSITORY / "data" / "objects.csv")
    assert len(rows) == 100
    for _, row in rows:
        source_object = Resolutions().source_object(row["source_id"])
        folder = f"fetched/{source_object.source.id}/{source_object.name}/"
        expected = {
            "ycb": (f"{folder}google_16k/textured.obj", f"{folder}google_16k/texture_map.png"),
            "gso": (f"{folder}meshes/model.obj", f"{folder}materials/textures/texture.png"),
            "polyhaven": (f"{folder}{source_object.name}_1k.gltf", ""),
        }[source_object.source.id]
        assert (row["mesh"], row["texture"]) == expected
