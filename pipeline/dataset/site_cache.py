"""The folder in which DVC notes what it knows of files, which its own user alone may write.

DVC's default, ``/var/tmp/dvc``, may be written by every user of a machine, and DVC unpickles what lies in it:
who replaces a note there has code run by the next command of DVC.
"""

import contextlib
import os
import stat
from pathlib import Path

from platformdirs import user_cache_path

from objectfolder.errors import InputError

SITE_CACHE = "DVC_SITE_CACHE_DIR"


def use_own_site_cache() -> Path:
    """Give DVC, in this process and those that it starts, a site cache of the user's own.

    Returns
    -------
    Path
        What ``DVC_SITE_CACHE_DIR`` names, else ``objectfolder/dvc`` in the user's cache folder.

    Raises
    ------
    InputError
        The folder cannot be made, is another user's, or may be written by others.
    """
    folder = Path(os.environ.get(SITE_CACHE) or _default())
    remedy = f"Set {SITE_CACHE} to a folder that you alone may write."
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
    except OSError as error:
        raise InputError(str(folder), f"cannot hold what DVC notes ({error.strerror})", remedy) from error
    if status.st_uid != os.getuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise InputError(str(folder), "others may write it, and DVC runs what lies there", remedy)
    os.environ[SITE_CACHE] = str(folder)
    return folder


def note_site_cache(root: Path) -> None:
    """Give the commands of DVC that a user types in a repository the same folder: in ``.dvc/config.local``.

    Nothing is noted where ``DVC_SITE_CACHE_DIR`` or the user's own settings name another, nor in a repository
    that this user may not write.
    """
    from dvc.config import Config

    settings = Config(str(root / ".dvc"), validate=False)
    own = (settings.load_one(level)["core"] for level in ("system", "global", "local"))
    if os.environ.get(SITE_CACHE) != str(_default()) or any("site_cache_dir" in core for core in own):
        return
    with contextlib.suppress(OSError), settings.edit("local", validate=False) as local:
        local["core"]["site_cache_dir"] = str(_default())


def _default() -> Path:
    return user_cache_path("objectfolder") / "dvc"
