"""How-to pages of data sets, run on toy bodies: what `data-sets.md`, `storage.md` and `audit.md` say to type.

Their lines are those of the pages, with folders in place of buckets. Not run here: samples, training and
xarray, which toy bodies do not have, and experiments of DVC, which make the set again.
"""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from published_set import command

from pipeline.cli import main
from pipeline.cli.printing import FAILED, FINE
from pipeline.dataset import stages

sys.path += [str(Path(__file__).parents[1] / name) for name in ("audit", "pipeline")]
from versions_of_workshop import GIT, made_versions

pytestmark = pytest.mark.release("docs", "pipeline.publish", "pipeline.audit", "pipeline.cli")
DOCS = Path(__file__).parents[2] / "docs"
IDS = ("mug", "bell", "fork", "bowl", "die", "plate", "spatula")
BUCKET, REPOSITORY = "s3://bucket/", "REPOSITORY"
OUTPUT_OF_ERROR = "objectfolder: "


def typed(page: str, *first_words: str) -> list[tuple[str, bool]]:
    """Lines of a page that begin with some words, and whether the page shows that they fail."""
    text = (DOCS / page).read_text(encoding="utf-8")
    blocks = re.findall(r"^```(?:console|bash)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    lines = [line for block in blocks for line in [*block.splitlines(), ""]]
    return [
        (line.removeprefix("$ ").partition("  #")[0].strip(), following.startswith(OUTPUT_OF_ERROR))
        for line, following in zip(lines, [*lines[1:], ""], strict=True)
        if line.removeprefix("$ ").startswith(first_words)
    ]


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    """A data set with a remote, whose version v1 has a bare clone beside it."""
    materials = dict.fromkeys(IDS, "steel")
    folder = tmp_path_factory.mktemp("how_to")
    with made_versions(folder, "workshop_of_how_to", **materials) as versions:
        command(folder, "git", "init", "-q", "--bare", "-b", "main", "bare.git")
        versions.git("remote", "add", "origin", str(folder / "bare.git"))
        yield versions


@pytest.fixture
def run(workshop, monkeypatch, capsys):
    """Type a line in the data set."""
    for name, value in GIT.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("DVC_NO_ANALYTICS", "1")
    monkeypatch.setenv("PYTHONPATH", str(workshop.root), prepend=":")  # of bodies, for what is made again
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=":")
    monkeypatch.chdir(workshop.root)
    monkeypatch.setattr(stages, "STAGES", {stage.name: stage for stage in workshop.stages})

    def called(line: str, fails: bool = False) -> str:
        if line.startswith("objectfolder "):
            status = main(shlex.split(line.partition(" > ")[0])[1:])
            out, error = capsys.readouterr()
            assert status == (FAILED if fails else FINE), (line, out, error)
            return str(out)
        done = subprocess.run(line, shell=True, capture_output=True, text=True, check=False)
        assert done.returncode == FINE, (line, done.stdout, done.stderr)
        return done.stdout

    return called


def test_pages_of_releases_and_of_audits(workshop, run):
    store = workshop.root.parent / "store"
    store.mkdir()
    workshop.declare()
    (workshop.root / "data/card.yaml").write_text("title: Cups\ncreators: [A. Maker]\nversion: 0.1.0\n")
    release = typed("data-sets.md", "dvc remote add", "git commit", "objectfolder release", "dvc push")
    assert [line.split()[0] for line, _ in release] == ["dvc", "git", "objectfolder", "dvc"]
    remote, commit, publish, push = (line for line, _ in release)
    run(remote.replace(f"{BUCKET}path", str(store)))
    run("git add -A && " + commit)
    run("objectfolder release v1")
    run("git push -q -u origin main && " + push)
    got = typed("data-sets.md", "objectfolder get")
    assert len(got) >= 6
    for line, fails in got:
        run(line, fails)
    assert (workshop.root / "set/data/touches/fork.zarr.zip").is_file()

    workshop.row("mug")["material"] = "glass"
    workshop.save()
    workshop.version("a glass mug")
    assert "1 changed since v1" in run(publish)
    run(push)
    for line, _ in typed("audit.md", "objectfolder"):
        run(line)
    assert (workshop.root / "audit.html").is_file()

    for line, _ in typed("storage.md", "dvc push", "dvc pull", "dvc get", "dvc import"):
        Path("mug.safetensors").unlink(missing_ok=True)  # the page shows two ways to it
        words = line.replace(REPOSITORY, str(workshop.root.parent / "bare.git")).replace("025_mug", "mug")
        run(words.replace("v1.0", "v1"))
