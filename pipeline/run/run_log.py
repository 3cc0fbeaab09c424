"""The failures of the last run of a stage, in full: ``runs/<stage>-failures.json``.

The record of every run is `pipeline.run.run_record`; what failed of the data set is
`pipeline.dataset.failures`; what tasks took is `pipeline.run.costs`.
"""

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path

from objectfolder.errors import SimulationError
from objectfolder.products.atomic import atomic_write
from pipeline.dataset.task import Failure


def unwritable(path: Path, error: OSError) -> SimulationError:
    """Return the error for a record of a run that cannot be written."""
    finding = f"cannot be written ({error.strerror or error})"
    return SimulationError(str(path), finding, "Make room, and run again: nothing finished is lost.")


def is_cut(path: Path) -> bool:
    """Return whether a kill cut the last line of a file short; False where there is no file."""
    try:
        with path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            return file.read(1) != b"\n"
    except OSError:  # no file, or an empty one
        return False


def write_failures(
    root: Path, stage: str, failures: Iterable[Failure], fingerprints: Mapping[str, str]
) -> None:
    """Write why objects failed in the last run of a stage, with the fingerprints that were wanted.

    Raises
    ------
    SimulationError
        They cannot be written.
    """
    entries = [
        {**asdict(failure), "fingerprint": fingerprints.get(failure.object_id)} for failure in failures
    ]
    path = _path(root, stage)
    try:
        with atomic_write(path) as file:
            file.write((json.dumps(entries, indent=1) + "\n").encode())
    except OSError as error:
        raise unwritable(path, error) from error


def read_failures(root: Path, stage: str) -> dict[Failure, str]:
    """Return the failures of the last run of a stage with their fingerprints, empty where there was none.

    What a kill cut short says nothing.
    """
    try:
        entries = json.loads(_path(root, stage).read_bytes())
        return {
            Failure(*(str(entry[name]) for name in ("object_id", "error", "remedy", "detail"))): str(
                entry["fingerprint"] or ""
            )
            for entry in entries
        }
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return {}


def _path(root: Path, stage: str) -> Path:
    return root / "runs" / f"{stage}-failures.json"
