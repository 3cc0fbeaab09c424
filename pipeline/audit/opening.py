"""Repositories under DVC opened without trust in their settings.

What is under version control is its author's, also in a clone of one's own. Of a remote in ``.dvc/config``,
only where it is and whether it is read without credentials are taken. Other settings, such as a file of
credentials, may name a command to run. They count where the user made them: in ``.dvc/config.local``, which
is not under version control, or for all repositories.
"""

import contextlib
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from objectfolder.errors import InputError
from pipeline.audit.cloning import clone
from pipeline.dataset.git_index import tracked_files
from pipeline.dataset.site_cache import note_site_cache, use_own_site_cache

PLACE = frozenset({"url", "endpointurl", "oss_endpoint", "account_name", "region"})  # in the words of DVC
TAKEN = PLACE | {"allow_anonymous_login"}
FOLDER, SETTINGS, OWN_SETTINGS = ".dvc", ".dvc/config", ".dvc/config.local"
MOST_HOPS = 10  # from a remote to the one that has an address
DEFAULT_BRANCH = "refs/remotes/origin/HEAD"  # of a clone
# Git's own words for: fail where a name or a password would be asked for.
UNASKED = {"GIT_TERMINAL_PROMPT": "0", "GIT_ASKPASS": "false"}


@contextlib.contextmanager
def opened_folder(folder: str, revision: str | None = None) -> Iterator[Any]:
    """Open the repository around a folder, as it lies there or at a revision.

    Yields
    ------
    dvc.repo.Repo
        Closed afterwards.

    Raises
    ------
    InputError
        It sets what only its user may set.
    dvc.exceptions.DvcException
        No repository under DVC, or one without this revision.
    """
    from dvc.repo import Repo

    use_own_site_cache()
    root = Path(Repo.find_root(folder))
    _check_settings(root, revision)
    note_site_cache(root)
    # `Repo.open` would take the folder's own cache for its remote where it has none.
    with contextlib.closing(Repo(str(root), rev=revision)) as repository:
        yield repository


@contextlib.contextmanager
def opened_clone(address: str, revision: str | None = None) -> Iterator[Any]:
    """Clone a repository to a temporary folder and open a revision, by default that of its default branch.

    Nobody is asked for a name or a password; git's credential helpers are.

    Yields
    ------
    dvc.repo.Repo
        Closed afterwards, and its clone removed.

    Raises
    ------
    InputError
        It sets what only its user may set, or is larger than `cloning.LARGEST_CLONE_BYTES`.
    dvc.exceptions.DvcException
        It cannot be cloned, is not under DVC, or has no such revision.
    """
    from dvc.repo import Repo
    from dvc.scm import CloneError
    from scmrepo.git import Git

    use_own_site_cache()
    with tempfile.TemporaryDirectory(prefix="objectfolder-get-") as scratch, _nobody_asked():
        root = Path(scratch) / "shallow"
        is_cloned = False
        if revision and not Git.is_sha(revision):  # a branch or tag needs no history
            with contextlib.suppress(CloneError):
                clone(address, root, revision)
                is_cloned = True
        if not is_cloned:
            root = Path(scratch) / "whole"
            clone(address, root)
        revision = revision or DEFAULT_BRANCH
        _check_settings(root, revision)
        settings = {"cache": {"dir": f"{scratch}/cache"}}
        with contextlib.closing(Repo(str(root), rev=revision, config=settings)) as repository:
            yield repository


def _check_settings(root: Path, revision: str | None) -> None:
    """Raise InputError where settings under version control go beyond those that are trusted."""
    from dvc.config import Config, merge
    from dvc.fs import GitFileSystem
    from dvc.scm import SCM

    _check_tracked(root)
    own = str(root / FOLDER)
    versions: list[Config] = [Config(own, validate=False)]
    if revision:
        files = GitFileSystem(scm=SCM(str(root)), rev=revision)
        versions.append(Config("/.dvc", local_dvc_dir=own, fs=files, validate=False))
    for settings in versions:
        everywhere: dict[str, Any] = {}
        for level in settings.SYSTEM_LEVELS:
            merge(everywhere, settings.load_one(level))
        local_settings, of_author = settings.load_one("local"), _remotes(settings.load_one("repo"))
        _check_chains(_remotes(everywhere) | of_author | _remotes(local_settings))
        for name, options in of_author.items():
            of_user, local = _remotes(everywhere).get(name, {}), _remotes(local_settings).get(name, {})
            for key in sorted(options.keys() - local.keys()):
                if key not in TAKEN:
                    finding = f"remote {name!r} sets {key}, which is taken from your own settings alone"
                    remedy = f"In a clone: `dvc remote modify --local {name} {key} VALUE`, if you want it."
                    raise InputError(SETTINGS, finding, remedy)
                if key in PLACE and of_user and of_user.get(key) != options[key]:
                    finding = f"remote {name!r} sets another {key} than your settings for all repositories"
                    raise InputError(SETTINGS, finding, f"Give your own {name!r} another name.")


def _check_tracked(root: Path) -> None:
    """Raise InputError where what DVC takes for a user's own is under version control, hence its author's."""
    for path in sorted(str(path.relative_to(root)) for path in tracked_files(root)):
        # By any case of letters, as some file systems read names.
        if path.lower() == OWN_SETTINGS:
            finding = "is under version control, but is for a user's own settings"
            raise InputError(path, finding, f"Ask its author, or `git rm --cached {path}`.")
        inside = path.lower().startswith(f"{FOLDER}/") and (root / path).is_symlink()
        if path.lower() == FOLDER or inside:  # git tracks a folder itself where it is a link or a submodule
            finding = "is a link or a repository of its own, through which DVC reads and writes elsewhere"
            raise InputError(path, finding, "Ask its author for a repository without it.")


def _check_chains(remotes: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise InputError where a remote lies in another (``remote://NAME/folder``) without end."""
    for name in remotes:
        remote, hops = name, 0
        while (place := urlsplit(str(remotes.get(remote, {}).get("url")))).scheme == "remote":
            remote, hops = place.netloc, hops + 1
            if hops > MOST_HOPS:
                finding = f"remote {name!r} lies in others, more than {MOST_HOPS} deep or in itself"
                raise InputError(SETTINGS, finding, "Give it an address of its own.")


def _remotes(settings: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the remotes in settings that DVC has not checked yet; it refuses malformed ones later."""
    remotes = settings.get("remote")
    by_name = remotes if isinstance(remotes, dict) else {}
    return {name: options for name, options in by_name.items() if isinstance(options, dict)}


@contextlib.contextmanager
def _nobody_asked() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in UNASKED}
    os.environ.update(UNASKED)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
