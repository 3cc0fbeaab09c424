"""``python -m pipeline.cli.reproduce [TARGET...]``: ``dvc repro``, and no advice to push to a remote."""

import sys
from collections.abc import Sequence
from pathlib import Path

from objectfolder.errors import ObjectFolderError
from pipeline.cli.printing import FAILED, FINE, print_error


def reproduce(targets: Sequence[str]) -> int:
    """Bring targets (none: the data set of this folder) up to date, and return the exit status."""
    from dvc.exceptions import DvcException
    from dvc.repo import Repo

    from pipeline.dataset.site_cache import note_site_cache, use_own_site_cache

    try:
        use_own_site_cache()
        note_site_cache(Path(Repo.find_root()))
        with Repo() as repository:
            repository.reproduce(list(targets))
    except DvcException as error:
        cause = f": {error.__cause__}" if error.__cause__ else ""
        print_error(f"{error}{cause}")
        return FAILED
    except ObjectFolderError as error:
        print_error(error)
        return FAILED
    return FINE


if __name__ == "__main__":
    sys.exit(reproduce(sys.argv[1:]))
