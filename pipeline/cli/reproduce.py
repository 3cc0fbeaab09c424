"""``python -m pipeline.cli.reproduce [TARGET...]``: ``dvc repro``, and no advice to push to a remote."""

import sys
from collections.abc import Sequence

from pipeline.cli.printing import FAILED, FINE, print_error


def reproduce(targets: Sequence[str]) -> int:
    """Bring targets (none: the data set of this folder) up to date, and return the exit status."""
    from dvc.exceptions import DvcException
    from dvc.repo import Repo

    try:
        with Repo() as repository:
            repository.reproduce(list(targets))
    except DvcException as error:
        cause = f": {error.__cause__}" if error.__cause__ else ""
        print_error(f"{error}{cause}")
        return FAILED
    return FINE


if __name__ == "__main__":
    sys.exit(reproduce(sys.argv[1:]))
