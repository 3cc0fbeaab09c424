"""``python -m pipeline.cli.reproduce [TARGET...]``: ``dvc repro``, and no advice to push to a remote."""

import os
import stat
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from objectfolder.errors import InputError, ObjectFolderError
from objectfolder.products.regular_file import irregular
from pipeline.cli.printing import FAILED, FINE, print_error

if TYPE_CHECKING:
    from dvc.repo import Repo


def reproduce(targets: Sequence[str]) -> int:
    """Bring targets (none: the data set of this folder) up to date, and return the exit status."""
    from dvc.exceptions import DvcException
    from dvc.repo import Repo

    from pipeline.dataset.site_cache import note_site_cache, use_own_site_cache

    try:
        use_own_site_cache()
        note_site_cache(Path(Repo.find_root()))
        with Repo() as repository:
            _require_files(repository)
            repository.reproduce(list(targets))
    except DvcException as error:
        cause = f": {error.__cause__}" if error.__cause__ else ""
        print_error(f"{error}{cause}")
        return FAILED
    except ObjectFolderError as error:
        print_error(error)
        return FAILED
    return FINE


def _require_files(repository: "Repo") -> None:
    """Raise InputError where DVC would read what is no file: it waits for ever at a named pipe."""
    index = repository.index
    for path in {item.fs_path for item in (*index.outs, *index.deps) if item.protocol == "local"}:
        for place, kind in _irregular_below(path):
            remedy = "Delete it, and put the file there if it is an input: a run makes products again."
            raise InputError(os.path.relpath(place), f"is {kind}, not a file", remedy)


def _irregular_below(path: str) -> Iterator[tuple[str, str]]:
    """Yield what is neither a file nor a folder, at or below a path, and its kind; links are followed."""
    if not os.path.exists(path):
        return
    mode = os.stat(path).st_mode
    if not stat.S_ISDIR(mode):
        if kind := irregular(mode):
            yield path, kind
        return
    with os.scandir(path) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False) or (not entry.is_file() and not entry.is_dir()):
                yield from _irregular_below(entry.path)


if __name__ == "__main__":
    sys.exit(reproduce(sys.argv[1:]))
