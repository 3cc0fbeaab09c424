"""Unfinished builds of single objects, in the user's cache folder, so that the same command resumes them.

``$XDG_CACHE_HOME/objectfolder/builds`` (by default below ``~/.cache``) has a folder for each mesh and Object
File: what the stages made so far. A build that succeeds removes its own. Each build first removes those that
were not touched for `MOST_DAYS`.
"""

import contextlib
import hashlib
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

from platformdirs import user_cache_path

from objectfolder.errors import InputError
from pipeline.run.exclusive import exclusive, owner

MOST_DAYS = 30.0


@contextlib.contextmanager
def unfinished_build(mesh: Path, output: Path) -> Iterator[Path]:
    """Yield the folder in which a mesh is made into an Object File; remove it if the block succeeds.

    Raises
    ------
    InputError
        The cache folder cannot be written; or another process makes this file from this mesh, and
        ``OBJECTFOLDER_WAIT`` seconds went by.
    """
    builds = user_cache_path("objectfolder") / "builds"
    digest = hashlib.sha256(f"{mesh.resolve()}\n{output.resolve()}".encode()).hexdigest()
    folder = builds / digest[:16]
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        remedy = "Set XDG_CACHE_HOME to a folder that can be, or give --keep FOLDER"
        finding = f"unfinished builds cannot be kept there ({error.strerror})"
        raise InputError(str(builds), finding, remedy) from error
    _prune(builds, folder)
    truth = folder / "truth"  # the lock stays beside it
    with exclusive(folder, f"the build of {output}"):
        yield truth
        shutil.rmtree(truth)


def _prune(builds: Path, own: Path) -> None:
    """Remove other builds that are old."""
    oldest = time.time() - 86_400 * MOST_DAYS
    for folder in builds.iterdir():
        with contextlib.suppress(FileNotFoundError):  # another build prunes too
            last_use_s = (folder / ".objectfolder").stat().st_mtime
            if last_use_s < oldest and folder != own and owner(folder) is None:
                shutil.rmtree(folder, ignore_errors=True)
