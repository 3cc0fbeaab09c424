"""What tasks cost and what failed last, beside the data set and outside its versions.

``.objectfolder/costs.csv`` has a row for every task ever run here (its products hold no timings), the
`KEPT_ROWS` last of an object and stage once it has grown large.
``runs/<stage>.jsonl`` is the last run of a stage, an object a line; ``runs/<stage>-failures.json`` its
failures. The record of every run is `pipeline.run.run_record`.
"""

import contextlib
import csv
import fcntl
import io
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from objectfolder.atomic import atomic_write
from objectfolder.errors import SimulationError
from pipeline.dataset.task import Failure, Outcome

COLUMNS = (
    "object",
    "stage",
    "fingerprint",
    "cpu_seconds",
    "wall_seconds",
    "peak_memory_mb",
    "key",
    "seconds_per_query",
)
QUERY = "query"
RUN_ID = "OBJECTFOLDER_RUN_ID"  # of the run that a process is part of
KEPT_ROWS = 5  # of an object and stage, beside the one with the highest peak
COMPACT_ABOVE_BYTES = 4 << 20


@dataclass(frozen=True)
class Cost:
    """What a task took; CPU seconds include its child processes."""

    wall_s: float
    cpu_s: float
    peak_memory_mb: float


def costs_path(root: Path) -> Path:
    """Return where the costs are kept."""
    return root / ".objectfolder" / "costs.csv"


class Costs:
    """Known costs of a stage's tasks, by fingerprint and by object.

    Parameters
    ----------
    root
        Root of the data set.
    stage
        Name of the stage.
    """

    def __init__(self, root: Path, stage: str) -> None:
        self._path = costs_path(root)
        self._stage = stage
        self._by_fingerprint: dict[str, Cost] = {}
        self._by_object: dict[str, Cost] = {}
        if not self._path.is_file():
            return
        with self._path.open(newline="", encoding="utf-8", errors="replace") as file:
            for row in csv.DictReader(file):
                if row.get("stage") != stage:
                    continue
                # A line that a kill cut short, or that is not of this table.
                with contextlib.suppress(KeyError, TypeError, ValueError):
                    numbers = [float(row[name]) for name in ("wall_seconds", "cpu_seconds", "peak_memory_mb")]
                    if all(math.isfinite(number) and number >= 0 for number in numbers):
                        cost = Cost(*numbers)
                        self._by_fingerprint[row["fingerprint"]] = self._by_object[row["object"]] = cost

    def of(self, fingerprint: str) -> Cost | None:
        """Return what the task with this fingerprint took when it ran here."""
        return self._by_fingerprint.get(fingerprint)

    def last_of(self, object_id: str) -> Cost | None:
        """Return what the task of this object took when it last ran here."""
        return self._by_object.get(object_id)

    def add(self, outcome: Outcome) -> None:
        """Note, at once and for good, what a task took and what its queries took."""
        cost = Cost(round(outcome.wall_s, 3), round(outcome.cpu_s, 3), round(outcome.peak_bytes / 1e6, 1))
        self._by_fingerprint[outcome.fingerprint] = self._by_object[outcome.object_id] = cost
        own = (outcome.object_id, self._stage, outcome.fingerprint)
        rows: list[tuple[object, ...]] = [(*own, cost.cpu_s, cost.wall_s, cost.peak_memory_mb, "", "")]
        for key, seconds in outcome.query_seconds.items():
            rows.append((outcome.object_id, QUERY, outcome.fingerprint, "", "", "", key, f"{seconds:.3g}"))
        text = io.StringIO()
        csv.writer(text).writerows(rows)
        _append(self._path, text.getvalue())


def compact(root: Path) -> None:
    """Keep the last rows of each object and stage, if the table of costs has grown large and would shrink.

    Raises
    ------
    SimulationError
        The table cannot be written.
    """
    path = costs_path(root)
    if not path.is_file() or path.stat().st_size < COMPACT_ABOVE_BYTES:
        return
    with _writing(path):
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        kept = _newest(rows)
        if len(kept) > len(rows) // 2:
            return
        text = io.StringIO()
        csv.writer(text).writerows([header, *kept])
        with atomic_write(path) as whole:
            whole.write(text.getvalue().encode())


def _newest(rows: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """Return, in order, the rows that `compact` keeps, the last one of each fingerprint."""
    key, stage, fingerprint, peak = (
        COLUMNS.index(name) for name in ("key", "stage", "fingerprint", "peak_memory_mb")
    )
    kept: set[int] = set()
    seen: dict[tuple[str, str, str], dict[str, int]] = {}
    highest: dict[tuple[str, str, str], tuple[float, int]] = {}
    for index in range(len(rows) - 1, -1, -1):
        row = rows[index]
        if len(row) != len(COLUMNS):  # a line that a kill cut short
            continue
        group = (row[0], row[stage], row[key])
        last = seen.setdefault(group, {})
        if row[fingerprint] not in last and len(last) < KEPT_ROWS:
            last[row[fingerprint]] = index
            kept.add(index)
        with contextlib.suppress(ValueError):
            highest[group] = max(highest.get(group, (0.0, index)), (float(row[peak]), index))
    return [rows[index] for index in sorted(kept | {index for _, index in highest.values()})]


def _append(path: Path, text: str) -> None:
    """Append whole lines to the table; one that a kill cut short stays alone on its line."""
    with _writing(path):
        new = not path.exists()
        with path.open("ab+") as file:
            if new:
                file.write((",".join(COLUMNS) + "\r\n").encode())
            elif file.seek(0, os.SEEK_END):
                file.seek(-1, os.SEEK_END)
                if file.read(1) != b"\n":
                    file.write(b"\r\n")
            file.write(text.encode())


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Hold a table against other processes that write it, and say so clearly where that fails."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.with_suffix(".lock").open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield
    except OSError as error:
        raise unwritable(path, error) from error


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
    run = os.environ.get(RUN_ID)
    entries = [
        {**asdict(failure), "fingerprint": fingerprints.get(failure.object_id), "run": run}
        for failure in failures
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


def read_failures_by_fingerprint(root: Path, stage: str) -> dict[str, Failure]:
    """Return what failed in a stage earlier in the run that this process is part of, by wanted fingerprint.

    Empty outside a run whose parts share ``OBJECTFOLDER_RUN_ID``.
    """
    run = os.environ.get(RUN_ID)
    return {
        entry["fingerprint"]: _failure(entry)
        for entry in _failure_entries(root, stage)
        if run and entry.get("run") == run and entry.get("fingerprint")
    }


def _failure(entry: Mapping[str, str]) -> Failure:
    return Failure(entry["object_id"], entry["error"], entry.get("remedy", ""), entry.get("detail", ""))


def _failure_entries(root: Path, stage: str) -> list[dict[str, Any]]:
    try:
        entries: list[dict[str, Any]] = json.loads((root / "runs" / f"{stage}-failures.json").read_text())
    except FileNotFoundError:
        return []
    return entries
