"""``python -m pipeline.cli.reproduce``: ``dvc repro`` without its advice to push: there may be no remote."""

import sys

from pipeline.cli.printing import FAILED, FINE, print_error


def reproduce() -> int:
    """Bring the data set of this folder up to date, and return the exit status."""
    from dvc.exceptions import DvcException
    from dvc.repo import Repo

    try:
        with Repo() as repository:
            repository.reproduce()
    except DvcException as error:
        cause = f": {error.__cause__}" if error.__cause__ else ""
        print_error(f"{error}{cause}")
        return FAILED
    return FINE


if __name__ == "__main__":
    sys.exit(reproduce())
