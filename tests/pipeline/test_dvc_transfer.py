"""Push, clone, pull and checkout of an older version, with this project's own stages and tiny outputs."""

import json
import os
import shutil
from collections.abc import Iterable
from contextlib import chdir
from pathlib import Path

import pygit2
import pytest
from dvc.repo import Repo
from repositories import opened
from toys import REPOSITORY

from pipeline.cli.printing import FAILED, FINE
from pipeline.cli.reproduce import reproduce
from pipeline.dataset.stages import STAGES
from pipeline.run.code_digests import REPORT, SENSOR, STARTER

COPIED = (
    "data/retry.json",
    "dvc.yaml",
    "params.yaml",
    *(f"learning/{name}" for name in ("dvc.yaml", "params.yaml")),
)
SIGNATURE = pygit2.Signature("t", "t@t")


def commit(root: Path, message: str) -> None:
    """Commit everything and tag it by the message."""
    git = pygit2.Repository(str(root))
    git.index.add_all()
    git.index.write()
    parents = [] if git.head_is_unborn else [git.head.target]
    commit_id = git.create_commit("HEAD", SIGNATURE, SIGNATURE, message, git.index.write_tree(), parents)
    git.create_reference(f"refs/tags/{message}", commit_id)


def made_data_set(root: Path, store: Path) -> dict[str, str]:
    """Make every output of the data set, none of the learning tasks; return a file of each with its text."""
    for name in COPIED:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(REPOSITORY / name, root / name)
    pygit2.init_repository(str(root))
    Repo.init(str(root)).close()
    (root / ".dvc" / "config").write_text(
        f"[core]\n    remote = store\n['remote \"store\"']\n    url = {store}\n"
    )
    texts = {}
    with opened(root) as repository:
        stages = [stage for stage in repository.index.stages if stage.path_in_repo == "dvc.yaml"]
        outs = {str(out): out for stage in stages for out in stage.outs}
        for name in outs:
            path = root / name
            if not path.suffix:
                path.mkdir(parents=True)
                path /= "mug"
            path.parent.mkdir(parents=True, exist_ok=True)
            keys = dict.fromkeys([*STAGES, STARTER, REPORT, SENSOR], "first")
            text = json.dumps({**keys, "stages": keys}) if path.suffix == ".json" else f"first {name}"
            path.write_text(text)
            texts[path.relative_to(root).as_posix()] = text
        deps = {str(dep) for stage in stages for dep in stage.deps} - outs.keys()
        for name in sorted(deps, reverse=True):  # what lies in a folder before the folder
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            if not (root / name).exists():
                (root / name).write_text("code")
        repository.commit(force=True, target="dvc.yaml")
    return texts


@pytest.mark.slow
def test_pushed_pulled_as_links_and_an_older_version_checked_out(tmp_path, capsys):
    root, store, clone = tmp_path / "made", tmp_path / "store", tmp_path / "clone"
    first = made_data_set(root, store)
    commit(root, "v1")
    (root / "data" / "views" / "mug").write_text("second")
    with opened(root) as repository:
        assert repository.push() > 0
        repository.commit(force=True, target="dvc.yaml")
        assert repository.push() > 0
    commit(root, "v2")

    pygit2.clone_repository(str(root), str(clone))
    (clone / ".dvc" / "config.local").write_text("[cache]\n    type = symlink\n")
    with opened(clone) as repository:
        repository.pull()
        assert read(clone, first) == first | {"data/views/mug": "second"}
        assert (clone / "data" / "views" / "mug").is_symlink()
    git = pygit2.Repository(str(clone))
    git.checkout("refs/tags/v1")
    with opened(clone) as repository:
        repository.fetch()
        repository.checkout()
    assert read(clone, first) == first
    assert not git.status()
    with chdir(clone):
        assert reproduce(["starter"]) == FINE
        assert reproduce(["nowhere"]) == FAILED
        assert "nowhere" in capsys.readouterr().err
        os.mkfifo("data/views/cup")  # DVC would wait for a writer
        assert reproduce(["starter"]) == FAILED
    assert "data/views/cup: is a named pipe, not a file. Delete it" in capsys.readouterr().err


def read(root: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the texts of files."""
    return {name: (root / name).read_text() for name in names}
