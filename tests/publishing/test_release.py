"""Two releases of a data set: checked, told apart, tagged, and fetched by somebody else."""

import csv
import json
import os
import sys
from pathlib import Path

import pytest
import yaml
from published_set import Server, command, serving

from objectfolder.products.store import read_product, write_product
from pipeline.cli import main
from pipeline.cli.printing import FAILED, FINE
from pipeline.dataset import stages
from pipeline.dataset.stages import FIDELITY, OBJECT_FILES

sys.path += [str(Path(__file__).parents[1] / name) for name in ("audit", "pipeline")]
from versions_of_workshop import GIT, made_versions

OTHERS = [f"bowl{number}" for number in range(18)]


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    """A data set of twenty objects, made and committed."""
    materials = {"cup": "steel", "dish": "wood", **dict.fromkeys(OTHERS, "iron")}
    with made_versions(tmp_path_factory.mktemp("release"), "workshop_of_release", **materials) as data_set:
        yield data_set


@pytest.fixture
def run(workshop, monkeypatch, capsys):
    """Run a command in the data set, on the stages over toy bodies."""
    for name, value in GIT.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(stages, "STAGES", {stage.name: stage for stage in workshop.stages})

    def called(*words, folder=workshop.root):
        monkeypatch.chdir(folder)
        return main(list(words)), *capsys.readouterr()

    return called


def declared(workshop):
    """Let DVC know the stages of ``dvc.lock``, and a store."""
    workshop.declare()
    store = workshop.root.parent / "store"
    (workshop.root / ".dvc/config").write_text(
        f"[core]\n    analytics = false\n    remote = store\n['remote \"store\"']\n    url = {store}\n"
    )
    return store


@pytest.mark.slow
def test_from_the_first_release_to_a_second_that_another_fetches(workshop, run, tmp_path):
    workshop.restore()
    root, store = workshop.root, declared(workshop)
    status, _, error = run("release", "v1")
    assert (status, "not as in HEAD" in error) == (FAILED, True)
    (root / "data/card.yaml").write_text("title: Cups\ncreators: [A. Maker]\nversion: 0.1.0\ndoi: 10.5/x\n")
    workshop.git("add", "-A")
    workshop.git("commit", "-qm", "where it is")
    status, out, error = run("release", "v1")
    assert status == FINE, error
    assert "v1: 20 objects, 20 changed" in out
    assert run("release", "v1")[0] == FAILED, "the tag is there"

    workshop.row("cup")["material"] = "glass"
    workshop.table = [row for row in workshop.table if row["id"] != OTHERS[0]]
    workshop.save()
    workshop.add("jug", "wood")
    workshop.version("a glass cup, and a jug in place of a bowl")
    status, out, error = run("release", "v2", "-o", str(tmp_path / "hub"))
    assert status == FINE, error
    assert "v2: 20 objects, 3 changed since v1" in out
    assert workshop.git("status", "--porcelain") == ""
    changelog = workshop.git("show", "v2:reports/CHANGELOG.md")
    newest, _, first = changelog.partition("## v1")
    assert "**changed**: cup\n" in newest
    assert "steel" in newest
    assert "**added**: jug\n" in newest
    assert f"**removed**: {OTHERS[0]}\n" in newest
    assert "dish" not in newest
    assert "cup, dish" in first
    rows = csv.DictReader(workshop.git("show", "v2:reports/object_versions.csv").splitlines())
    versions = {row["object"]: row["version"] for row in rows}
    assert versions == {**dict.fromkeys([*OTHERS[1:], "dish"], "v1"), "cup": "v2", "jug": "v2"}
    zenodo = json.loads(workshop.git("show", "v2:.zenodo.json"))
    assert (zenodo["doi"], zenodo["creators"]) == ("10.5/x", [{"name": "A. Maker"}])
    assert zenodo["version"].startswith("2.0.0+")
    card = (tmp_path / "hub/README.md").read_text()
    assert yaml.safe_load(card.split("---")[1])["pretty_name"] == "Cups"
    assert (tmp_path / "hub/data/object_files/cup.safetensors").is_file()

    command(root, sys.executable, "-m", "dvc", "push", "-q")
    with serving(Server(store)) as server:
        config = (root / ".dvc/config").read_text().replace(str(store), server.address)
        (root / ".dvc/config").write_text(config)
        workshop.git("commit", "-qam", "for readers")
        workshop.git("tag", "--force", "v2")
        command(root.parent, "git", "clone", "-q", "--bare", str(root), str(tmp_path / "bare.git"))
        status, out, error = run("get", f"{tmp_path}/bare.git@v2", "-o", "got", folder=tmp_path)
        assert status == FINE, error
        files = {path.stem: path.read_bytes() for path in (tmp_path / "got").glob("*.safetensors")}
        assert files == {name: OBJECT_FILES.path(root, name).read_bytes() for name in versions}


def test_what_states_no_fidelity_or_is_damaged_is_not_released(workshop, run):
    workshop.restore()
    declared(workshop)
    product = read_product(fidelity := FIDELITY.path(workshop.root, "cup"))
    fidelity.unlink()
    write_product(fidelity, product.with_attributes(touch={}))
    workshop.version("without touch", make=False)
    status, _, error = run("release", "v3")
    assert (status, "cup: states no fidelity of touch" in error) == (FAILED, True)
    path = OBJECT_FILES.path(workshop.root, "cup")
    whole = path.read_bytes()
    os.remove(path)
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    status, _, error = run("release", "v3")
    assert (status, "data/object_files/cup.safetensors: damaged" in error) == (FAILED, True)
    assert run("release", "three")[0] == FAILED
    assert run("select", "--only", "dish")[0] == FINE
    status, _, error = run("release", "v3")
    assert (status, "data/selection/only.txt: objects are selected" in error) == (FAILED, True)
    status, _, error = run("release", "v3", "-o", str(workshop.root))
    assert (status, f"{workshop.root}: is there already" in error) == (FAILED, True)
    assert workshop.git("tag", "--list") == ""
