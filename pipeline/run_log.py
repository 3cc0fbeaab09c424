"""What tasks cost and why they failed, beside the data set and outside its versions.

``.objectfolder/costs.csv`` has a row for every task ever run here (its products hold no timings).
``runs/<stage>.jsonl`` is the last run of a stage, an object a line; ``runs/<stage>-failures.json`` its
failures.
"""

import contextlib
import csv
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipeline.task import Failure, Outcome

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
        with self._path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                if row["stage"] != stage:
                    continue
                with contextlib.suppress(TypeError, ValueError):  # a line that a kill cut short
                    numbers = [float(row[name]) for name in ("wall_seconds", "cpu_seconds", "peak_memory_mb")]
                    self._by_fingerprint[row["fingerprint"]] = self._by_object[row["object"]] = Cost(*numbers)

    def of(self, fingerprint: str) -> Cost | None:
        """Return what the task with this fingerprint took when it ran here."""
        return self._by_fingerprint.get(fingerprint)

    def last_of(self, object_id: str) -> Cost | None:
        """Return what the task of this object took when it last ran here."""
        return self._by_object.get(object_id)

    def expected(self, sizes: Mapping[str, int]) -> dict[str, float]:
        """Return expected seconds by object: the last known ones, else in proportion to input bytes."""
        known = [
            (self._by_object[name].wall_s, size) for name, size in sizes.items() if name in self._by_object
        ]
        total = sum(size for _, size in known)
        rate = sum(seconds for seconds, _ in known) / total if total else 1e-6
        return {
            name: self._by_object[name].wall_s if name in self._by_object else rate * size
            for name, size in sizes.items()
        }

    def add(self, outcome: Outcome) -> None:
        """Note, at once and for good, what a task took and what its queries took."""
        cost = Cost(round(outcome.wall_s, 3), round(outcome.cpu_s, 3), round(outcome.peak_bytes / 1e6, 1))
        self._by_fingerprint[outcome.fingerprint] = self._by_object[outcome.object_id] = cost
        own = (outcome.object_id, self._stage, outcome.fingerprint)
        rows: list[tuple[object, ...]] = [(*own, cost.cpu_s, cost.wall_s, cost.peak_memory_mb, "", "")]
        for key, seconds in outcome.query_seconds.items():
            rows.append((outcome.object_id, QUERY, outcome.fingerprint, "", "", "", key, f"{seconds:.3g}"))
        self._path.parent.mkdir(parents=True, exist_ok=True)
        new = not self._path.exists()
        with self._path.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([COLUMNS, *rows] if new else rows)


def write_run(
    root: Path, stage: str, lines: Iterable[Mapping[str, Any]], failures: Iterable[Failure]
) -> None:
    """Write the log and the failures of a run."""
    folder = root / "runs"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{stage}.jsonl").write_text("".join(json.dumps(dict(line)) + "\n" for line in lines))
    (folder / f"{stage}-failures.json").write_text(
        json.dumps([asdict(failure) for failure in failures], indent=1) + "\n"
    )


def read_failures(root: Path, stage: str) -> list[Failure]:
    """Return the failures of the last run of a stage; none where it never ran."""
    try:
        return [
            Failure(**entry) for entry in json.loads((root / "runs" / f"{stage}-failures.json").read_text())
        ]
    except FileNotFoundError:
        return []
