"""What a stage did and what failed when it last ran.

``runs/<stage>.jsonl`` is the last run of a stage, an object a line; ``runs/<stage>-failures.json`` its
failures. The record of every run is `pipeline.run.run_record`; what tasks took is `pipeline.run.costs`.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from objectfolder.atomic import atomic_write
from objectfolder.errors import SimulationError
from pipeline.dataset.task import Failure


def unwritable(path: Path, error: OSError) -> SimulationError:
    """Return what to raise where a record of a run cannot be written."""
    finding = f"cannot be written ({error.strerror or error})"
    return SimulationError(str(path), finding, "Make room, and run again: nothing finished is lost.")


def write_run(
    root: Path, stage: str, lines: Iterable[Mapping[str, Any]], failures: Iterable[Failure]
) -> None:
    """Write the last run of a stage and its failures.

    Parameters
    ----------
    root
        Root of the data set.
    stage
        Name of the stage.
    lines
        An object each; ``object_id`` and ``fingerprint`` of those that failed stand beside the failures.
    failures
        Why objects failed.

    Raises
    ------
    SimulationError
        They cannot be written.
    """
    folder = root / "runs"
    lines = [dict(line) for line in lines]
    fingerprints = {line["object_id"]: line.get("fingerprint") for line in lines if "object_id" in line}
    entries = [
        {**asdict(failure), "fingerprint": fingerprints.get(failure.object_id)} for failure in failures
    ]
    try:
        with atomic_write(folder / f"{stage}.jsonl") as file:
            file.write("".join(json.dumps(line) + "\n" for line in lines).encode())
        with atomic_write(folder / f"{stage}-failures.json") as file:
            file.write((json.dumps(entries, indent=1) + "\n").encode())
    except OSError as error:
        raise unwritable(folder, error) from error


def read_failures(root: Path, stage: str) -> list[Failure]:
    """Return the failures of the last run of a stage; none where it never ran."""
    return [_failure(entry) for entry in _failure_entries(root, stage)]


def _failure(entry: Mapping[str, str]) -> Failure:
    return Failure(entry["object_id"], entry["error"], entry.get("remedy", ""), entry.get("detail", ""))


def _failure_entries(root: Path, stage: str) -> list[dict[str, Any]]:
    try:
        entries: list[dict[str, Any]] = json.loads((root / "runs" / f"{stage}-failures.json").read_text())
    except FileNotFoundError:
        return []
    return entries
