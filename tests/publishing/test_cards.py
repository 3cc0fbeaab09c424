"""Cards: valid to the readers they are for, equal for equal data, honest about what is not stated."""

import json
import os
import shutil

import pytest
import yaml
from card_data import REPOSITORY, row, write_data_set

from objectfolder.errors import InputError
from objectfolder.products.provenance import file_digest
from objectfolder.products.splits import OBJECT_SPLITS, object_split
from pipeline.cli import main
from pipeline.dataset.failures import FailedObject, write_failures
from pipeline.dataset.stages import STAGES
from pipeline.publish.data_set import write_cards

CARDS = ("croissant.json", "data_card.md", "CITATION.cff")
HOSTILE = '<script>alert(1)</script> | `x` [a](javascript:b) *b* "q" \\ ünïcode 陶'


def loaded(folder):
    import mlcroissant

    return mlcroissant.Dataset(folder / "croissant.json")


def records(folder, name):
    """Records with plain keys; a loader gives text of files as bytes."""
    as_text = name != "object_files"
    return [
        {
            key.partition("/")[2]: value.decode() if isinstance(value, bytes) and as_text else value
            for key, value in record.items()
        }
        for record in loaded(folder).records(name)
    ]  # fmt: skip


def front_matter(folder):
    text = (folder / "data_card.md").read_text(encoding="utf-8")
    assert text.startswith("---\n")
    front, body = text[4:].split("\n---\n", 1)
    return yaml.safe_load(front), body


def citation(path):
    import jsonschema

    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    schema = json.loads((REPOSITORY / "tests/publishing/citation_file_schema.json").read_text())
    jsonschema.validate(content, schema)
    return content


@pytest.fixture
def folder(tmp_path):
    rows = {"cup": row("Cup"), "fork": row("Fork, of steel", "CC BY 4.0", "B. Scanner", "museum")}
    folder = write_data_set(tmp_path, rows)
    write_cards(tmp_path, folder)
    return folder


@pytest.mark.slow
def test_croissant_is_valid_and_loads(folder, tmp_path):
    data_set = loaded(folder)
    assert data_set.metadata.ctx.conforms_to.value == "http://mlcommons.org/croissant/1.1"
    assert not data_set.metadata.ctx.issues.errors
    # What the publisher alone knows is missing, and nothing else.
    assert [
        str(issue) for issue in data_set.metadata.ctx.issues.warnings if "datePublished" not in str(issue)
    ] == []
    figures = records(folder, "objects")
    assert [entry["id"] for entry in figures] == ["cup", "fork"]
    assert [entry["vision.psnr_db"] for entry in figures] == [50.0, 51.0]
    assert figures[0]["audio.gain_error_db"] is None
    assert [entry["licence"] for entry in figures] == ["CC0-1.0", "CC-BY-4.0"]
    assert [entry["split"] for entry in figures] == [object_split(name, "steel") for name in ("cup", "fork")]
    files = records(folder, "object_files")
    assert {entry["filename"].decode(): entry["content"] for entry in files} == {
        f"{name}.safetensors": (tmp_path / f"data/object_files/{name}.safetensors").read_bytes()
        for name in ("cup", "fork")
    }  # fmt: skip


def test_croissant_states_sizes_and_digests(folder, tmp_path):
    said = json.loads((folder / "croissant.json").read_text())
    files = {entry["name"]: entry for entry in said["distribution"] if entry["@type"] == "cr:FileObject"}
    path = tmp_path / "data/object_files/cup.safetensors"
    assert files["cup.safetensors"]["sha256"] == file_digest(path)
    assert files["cup.safetensors"]["contentSize"] == f"{path.stat().st_size} B"
    assert (folder / files["cup.safetensors"]["contentUrl"]).samefile(path)


def test_a_changed_object_file_is_noticed_by_a_loader(folder, tmp_path):
    path = tmp_path / "data/object_files/cup.safetensors"
    path.write_bytes(path.read_bytes()[:-1] + b"\xff")
    with pytest.raises(Exception, match="file/cup") as raised:
        records(folder, "object_files")
    assert "not identical with the" in str(raised.value.__cause__)


def test_the_card_has_what_hugging_face_reads_and_all_sources(folder):
    front, body = front_matter(folder)
    assert front["license"] == ["cc-by-4.0", "cc0-1.0"]
    assert front["size_categories"] == ["n<1K"]
    assert front["configs"][0]["data_files"] == "reports/per_object.csv"
    assert "- museum; CC-BY-4.0; attribution: B. Scanner. 1 object: `fork`" in body
    assert "- scans; CC0-1.0; attribution: A. Maker. 1 object: `cup`" in body
    assert "| vision: View, PSNR of the full image (dB) | 50.5 | 50.0 |" in body
    assert "PSNR of \\|images\\| on white" in body


def test_citation_files_are_valid(folder):
    said = citation(folder / "CITATION.cff")
    assert [entry["title"] for entry in said["references"]] == ["ObjectFolder Factory", "museum", "scans"]
    assert said["authors"] == [{"name": "anonymous"}]
    assert "license" not in said  # two apply, to different objects
    assert citation(REPOSITORY / "CITATION.cff")["type"] == "software"


def test_equal_data_sets_give_equal_bytes(folder, tmp_path, tmp_path_factory):
    before = {name: (folder / name).read_bytes() for name in CARDS}
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "copy"
    shutil.copytree(tmp_path, elsewhere)
    for path in sorted(elsewhere.rglob("*"), reverse=True):
        os.utime(path, (1, 1))
    write_cards(elsewhere, elsewhere / "reports")
    assert {name: (elsewhere / "reports" / name).read_bytes() for name in CARDS} == before
    object_file = elsewhere / "data/object_files/cup.safetensors"
    object_file.write_bytes(object_file.read_bytes() + b"\0")
    write_cards(elsewhere, elsewhere / "reports")
    assert all((elsewhere / "reports" / name).read_bytes() != before[name] for name in CARDS)


def test_failures_and_statements_that_are_missing_are_said(tmp_path):
    rows = {"cup": row("Cup", "", "", ""), "fork": row("Fork"), "gone": row("Gone")}
    failure = FailedObject("gone", "modes", f"{tmp_path}/data/x.obj: <b>no</b>\nfaces", "")
    write_failures(tmp_path, [failure], tuple(STAGES.values()))
    refused = [("odd", "objects.csv row 4: length_m is -1")]
    folder = write_data_set(tmp_path, rows, ids={"cup", "fork"}, refused=refused)
    write_cards(tmp_path, folder)
    front, body = front_matter(folder)
    assert front["license"] == ["cc0-1.0", "unknown"]
    assert "**No licence is stated for 1 object.**" in body
    assert "- source not stated; no licence stated; attribution: not stated. 1 object: `cup`" in body
    assert "- `gone`, stage modes: data/x.obj: &lt;b&gt;no&lt;/b&gt; faces" in body
    assert "- `odd`, stage objects: objects.csv row 4: length\\_m is -1" in body
    assert str(tmp_path) not in body
    said = json.loads((folder / "croissant.json").read_text())
    assert said["license"] == "https://spdx.org/licenses/CC0-1.0.html"
    assert "No licence is stated for 1 object." in said["description"]
    assert {entry["id"]: entry["licence"] for entry in records(folder, "objects")}["cup"] == ""
    assert citation(folder / "CITATION.cff")["references"][1]["notes"].startswith("no licence stated")


def test_one_licence_written_in_two_ways_is_one(tmp_path):
    rows = {"cup": row("Cup", "CC BY 4.0"), "fork": row("Fork", "CC-BY-4.0"), "mug": row("Mug", "cc by 4.0")}
    folder = write_data_set(tmp_path, rows)
    write_cards(tmp_path, folder)
    assert json.loads((folder / "croissant.json").read_text())["license"] == (
        "https://spdx.org/licenses/CC-BY-4.0.html"
    )
    front, body = front_matter(folder)
    assert front["license"] == "cc-by-4.0"
    assert "- scans; CC-BY-4.0; attribution: A. Maker. 3 objects: `cup`, `fork`, `mug`" in body


def test_a_data_set_without_a_licence_states_none(tmp_path):
    folder = write_data_set(tmp_path, {"cup": row("Cup", "not stated")})
    write_cards(tmp_path, folder)
    assert "license" not in json.loads((folder / "croissant.json").read_text())
    assert front_matter(folder)[0]["license"] == "unknown"
    assert "license" not in citation(folder / "CITATION.cff")
    loaded(folder)


def test_text_of_strangers_stays_text(tmp_path):
    folder = write_data_set(tmp_path, {"cup": row(HOSTILE, HOSTILE, HOSTILE + "\n# heading", HOSTILE)})
    write_cards(tmp_path, folder)
    front, body = front_matter(folder)
    assert front["license"] == "other"
    assert front["license_name"] == HOSTILE
    assert "<script" not in body
    assert "\n# heading" not in body
    assert "](javascript" not in body.replace("\\]", "")
    assert records(folder, "objects")[0]["attribution"] == HOSTILE + " # heading"
    assert records(folder, "objects")[0]["name"] == HOSTILE
    assert citation(folder / "CITATION.cff")["references"][1]["title"] == HOSTILE


@pytest.mark.parametrize("ids", [("007", "0100"), ("NA", "null")])
def test_ids_that_a_loader_would_garble_are_exact(tmp_path, ids):
    folder = write_data_set(tmp_path, {object_id: row("None") for object_id in ids})
    write_cards(tmp_path, folder)
    read = records(folder, "objects")
    assert sorted(entry["id"] for entry in read) == sorted(ids)
    assert {entry["name"] for entry in read} == {"None"}
    assert {entry["vision.psnr_db"] for entry in read} == {50.0, 51.0}


def test_a_data_set_of_nothing_has_cards(tmp_path):
    folder = write_data_set(tmp_path, {"cup": row("Cup")}, ids=set())
    write_cards(tmp_path, folder)
    loaded(folder)
    assert "0 objects" in front_matter(folder)[1]
    citation(folder / "CITATION.cff")


def test_the_publisher_states_what_no_product_knows(folder, tmp_path, capsys):
    (tmp_path / "data/card.yaml").write_text(
        "title: Cups\nversion: 2.1.0\ndate: 2026-11-21\nurl: https://example.org/cups\n"
        "files_url: https://example.org/files/\ndoi: 10.1234/cups\ncreators: [Ada, Grace]\n"
    )
    assert main(["cards", str(tmp_path)]) == 0
    said = json.loads((folder / "croissant.json").read_text())
    assert said["name"] == "Cups"
    assert said["datePublished"] == "2026-11-21"
    assert said["version"].startswith("2.1.0+")
    assert (
        said["distribution"][0]["contentUrl"] == "https://example.org/files/data/object_files/cup.safetensors"
    )
    assert not loaded(folder).metadata.ctx.issues.warnings
    cited = citation(folder / "CITATION.cff")
    assert cited["authors"] == [{"name": "Ada"}, {"name": "Grace"}]
    assert cited["doi"] == "10.1234/cups"


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("titel: x", "unknown key titel. Did you mean title"),
        ("date: soon", "date is 'soon'. It must be a valid date"),
        ("url: javascript:alert(1)", "url is 'javascript:alert.*http"),
        ("a: [", "cannot be read"),
    ],
)
def test_wrong_statements_are_refused(folder, tmp_path, text, match):
    (tmp_path / "data/card.yaml").write_text(text)
    with pytest.raises(InputError, match=match):
        write_cards(tmp_path, folder)


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [("per_object.csv", "a,b\n1,2\n", "it has no column id"), ("metrics.json", "{", "cannot be read")],
)
def test_a_damaged_report_is_named(folder, tmp_path, name, text, match):
    (folder / name).write_text(text)
    with pytest.raises(InputError, match=rf"{name}: {match}"):
        write_cards(tmp_path, folder)


def test_splits_are_stable_and_of_the_stated_shares():
    # Published: these may never change.
    assert object_split("mug", "ceramic") == "train"
    assert object_split("bell", "iron") == "validation"
    assert object_split("cup-9", "ceramic") == "test"
    shares = [[object_split(f"object {i}", m) for i in range(4000)] for m in ("steel", "wood")]
    for split, share in zip(OBJECT_SPLITS, (0.8, 0.1, 0.1), strict=True):
        assert abs(shares[0].count(split) / 4000 - share) < 0.02
    assert shares[0] != shares[1]
