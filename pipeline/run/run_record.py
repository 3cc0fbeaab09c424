"""The record of every run: ``runs/<time>-<id>.jsonl``, written as the run goes, a JSON object a line.

Every line has ``time`` (UTC), ``event`` and ``run``. Events are ``start`` (what runs, where and of which
version), ``task`` (one try of a stage and object: outcome, seconds, peak memory, worker, fingerprint and
why it failed), ``stage`` (how many objects were kept, restored, computed, failed and removed) and ``end``.
Objects that needed nothing are counted, not listed. A run that was killed has no ``end``, and its last
line may be cut.

The last `MOST_RUNS` files stay, as far as they fit into `MOST_BYTES`.
"""

import json
import os
import platform
import secrets
import socket
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pipeline.dataset.task import Outcome
from pipeline.run.costs import compact, unwritable

PATTERN = "[0-9]*T[0-9]*Z-*.jsonl"
MOST_RUNS = 200
MOST_BYTES = 256 << 20
DETAIL_CHARACTERS = 2000


class RunRecord:
    """The open record of a run of stages, or of a part of one.

    Raises
    ------
    SimulationError
        The record cannot be written (so does every method).
    """

    def __init__(self, root: Path, stages: Sequence[str]) -> None:
        self.run_id = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{secrets.token_hex(4)}"
        self.path = root / "runs" / f"{self.run_id}.jsonl"
        self._root = root
        self._tasks = 0
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise unwritable(self.path, error) from error
        self._write(
            "start",
            stages=list(stages),
            command=sys.argv,
            host=socket.gethostname(),
            pid=os.getpid(),
            python=platform.python_version(),
            version=version("objectfolder-factory"),
        )

    def __enter__(self) -> "RunRecord":
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self._write(
            "end", tasks=self._tasks, error=None if error is None else f"{type(error).__name__}: {error}"
        )
        os.close(self._file)
        for path in excess(self._root):
            path.unlink(missing_ok=True)
        if self._tasks:
            compact(self._root)

    def task(self, stage: str, outcome: Outcome, slot: str = "", host: str = "", tries: int = 1) -> None:
        """Note how a task ended, where it ran, and how often it was started in this run."""
        self._tasks += 1
        failure = outcome.failure
        self._write(
            "task",
            stage=stage,
            object=outcome.object_id,
            outcome="computed" if failure is None else "failed",
            fingerprint=outcome.fingerprint or None,
            wall_s=round(outcome.wall_s, 3),
            cpu_s=round(outcome.cpu_s, 3),
            peak_memory_mb=round(outcome.peak_bytes / 1e6, 1),
            slot=slot,
            host=host,
            tries=tries,
            error=failure and failure.error,
            remedy=failure and failure.remedy,
            detail=failure and failure.detail[-DETAIL_CHARACTERS:],
        )

    def stage(self, stage: str, removed: Sequence[str] = (), **objects: int) -> None:
        """Note the outcome of a stage: counts of objects, and ids of those whose products were removed."""
        self._write("stage", stage=stage, **objects, removed=list(removed))

    def _write(self, event: str, **values: Any) -> None:
        time = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"time": time, "event": event, "run": self.run_id, **values}) + "\n"
        try:
            os.write(self._file, line.encode())  # one call, so that no line is mixed with another's
        except OSError as error:
            raise unwritable(self.path, error) from error


def records(root: Path) -> list[Path]:
    """Return the paths of all records, the latest run last."""
    return sorted((root / "runs").glob(PATTERN))


def excess(root: Path) -> list[Path]:
    """Return the oldest records beyond the limits of number and size."""
    room, paths = MOST_BYTES, []
    for index, path in enumerate(reversed(records(root))):
        room -= path.stat().st_size
        if index and (index >= MOST_RUNS or room < 0):
            paths.append(path)
    return paths
