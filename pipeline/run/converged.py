"""``python -m pipeline.run.converged``: exit 0 where this very `dvc repro` has converged all stages already.

The commands of single stages in ``dvc.yaml`` ask this first, so that nothing slow is imported to do nothing.
"""

import sys
from pathlib import Path

from pipeline.dataset.run_id import driving_dvc, new_run_id

CONVERGED = Path(".objectfolder/converged")  # the last run that converged all stages


def is_converged(root: Path) -> bool:
    """Return whether this process is part of a `dvc repro` that called `note_converged`."""
    try:
        return driving_dvc() is not None and (root / CONVERGED).read_text() == new_run_id()
    except FileNotFoundError:
        return False


def forget_converged(root: Path) -> None:
    """Note that the stages may be behind their inputs."""
    (root / CONVERGED).unlink(missing_ok=True)


def note_converged(root: Path) -> None:
    """Note that this run has converged all stages."""
    (root / CONVERGED).write_text(new_run_id())


if __name__ == "__main__":
    sys.exit(not is_converged(Path.cwd()))
