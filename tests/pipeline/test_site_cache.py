"""The folder in which DVC notes what it knows of files: the user's own."""

import os

import pytest
from dvc.config import Config
from dvc.repo import Repo

from objectfolder.errors import InputError
from pipeline.dataset.site_cache import SITE_CACHE, note_site_cache, use_own_site_cache


@pytest.fixture
def _no_site_cache(tmp_path, monkeypatch):
    monkeypatch.setenv(SITE_CACHE, "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.mark.usefixtures("_no_site_cache")
def test_dvc_notes_in_a_folder_of_the_users_own(tmp_path, monkeypatch):
    folder = use_own_site_cache()
    assert folder == tmp_path / "cache/objectfolder/dvc"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert os.environ[SITE_CACHE] == str(folder)

    root = tmp_path / "set"
    root.mkdir()
    Repo.init(str(root), no_scm=True).close()
    (root / ".dvc/config").write_text("[core]\n    site_cache_dir = /elsewhere\n    no_scm = true\n")
    note_site_cache(root)
    monkeypatch.delenv(SITE_CACHE)  # as in the shell of a user, who types `dvc pull`
    with Repo(str(root)) as repository:
        assert repository.site_cache_dir.startswith(f"{folder}/repo/")


@pytest.mark.usefixtures("_no_site_cache")
def test_what_a_user_has_set_stays(tmp_path, monkeypatch):
    (tmp_path / ".dvc").mkdir()
    monkeypatch.setenv("DVC_GLOBAL_CONFIG_DIR", str(tmp_path))
    (tmp_path / "config").write_text("[core]\n    site_cache_dir = /mine\n")
    use_own_site_cache()
    note_site_cache(tmp_path)
    assert not (tmp_path / ".dvc/config.local").exists()
    assert Config(str(tmp_path / ".dvc"))["core"]["site_cache_dir"] == "/mine"


def test_a_folder_that_others_may_write_is_refused(tmp_path, monkeypatch):
    tmp_path.chmod(0o777)
    monkeypatch.setenv(SITE_CACHE, str(tmp_path))
    with pytest.raises(InputError, match="others may write it, and DVC runs what lies there"):
        use_own_site_cache()
