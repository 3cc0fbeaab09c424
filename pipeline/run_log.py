"""What tasks cost and why they failed, beside the data set and outside its versions.

``runs/<stage>.jsonl`` is the last run of a stage, an object a line; ``runs/<stage>-failures.json`` its
failures. ``.objectfolder/costs.jsonl`` keeps the cost of every task ever run here.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipeline.task import Failure, Outcome


@dataclass(frozen=True)
class Cost:
    """What a task took; CPU seconds include its child processes."""

    wall_s: float
    cpu_s: float
    peak_bytes: int


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
        self._path = root / ".objectfolder" / "costs.jsonl"
        self._stage = stage
        self._by_fingerprint: dict[str, Cost] = {}
        self._by_object: dict[str, Cost] = {}
        for line in _lines(self._path):
            if line.get("stage") == stage:
                cost = Cost(line["wall_s"], line["cpu_s"], line["peak_bytes"])
                self._by_fingerprint[line["fingerprint"]] = self._by_object[line["object_id"]] = cost

    def of(self, fingerprint: str) -> Cost | None:
        """Return what the task with this fingerprint took when it ran here."""
        return self._by_fingerprint.get(fingerprint)

    def expected(self, sizes: Mapping[str, int]) -> dict[str, float]:
        """Return expected seconds by object: the last known ones, else in proportion to input bytes."""
        known = [(self._by_object[name].wall_s, size) for name, size in sizes.items() if name in self._by_object]
        total = sum(size for _, size in known)
        rate = sum(seconds for seconds, _ in known) / total if total else 1e-6
        return {
            name: self._by_object[name].wall_s if name in self._by_object else rate * size
            for name, size in sizes.items()
        }

    def add(self, outcome: Outcome) -> None:
        """Note, at once and for good, what a task took."""
        cost = Cost(round(outcome.wall_s, 3), round(outcome.cpu_s, 3), outcome.peak_bytes)
        self._by_fingerprint[outcome.fingerprint] = self._by_object[outcome.object_id] = cost
        line = {"stage": self._stage, "object_id": outcome.object_id, "fingerprint": outcome.fingerprint}
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("a") as file:
            file.write(json.dumps({**line, **asdict(cost)}) + "\n")


def write_run(root: Path, stage: str, lines: Iterable[Mapping[str, Any]], failures: Iterable[Failure]) -> None:
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
        return [Failure(**entry) for entry in json.loads((root / "runs" / f"{stage}-failures.json").read_text())]
    except FileNotFoundError:
        return []


def read_costs(root: Path) -> dict[str, dict[str, Cost]]:
    """Return the known cost of the present products: stage, then object."""
    found: dict[str, dict[str, Cost]] = {}
    for path in sorted((root / "runs").glob("*.jsonl")):
        found[path.stem] = {
            line["object_id"]: Cost(line["wall_s"], line["cpu_s"], line["peak_bytes"])
            for line in _lines(path)
            if line.get("cpu_s") is not None
        }
    return found


def _lines(path: Path) -> list[dict[str, Any]]:
    """Return the whole lines of a file that a kill may have cut short."""
    try:
        text = path.read_text()
    except FileNotFoundError:
        return []
    lines = []
    for line in text.splitlines():
        try:
            lines.append(json.loads(line))
        except ValueError:
            continue
    return lines
