"""What tasks are known to have cost: in one data set, and in the hundred scans the package was tried on.

``known_costs.csv`` beside this module has a row for every object and stage of a data set of real scans at
the default size (and of the starter set), one thread a task; ``python -m bench.known_costs`` wrote it.
"""

import contextlib
import csv
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from pipeline.dataset.stage import Stage
from pipeline.run.run_log import COLUMNS, QUERY, costs_path

PACKAGED = Path(__file__).with_name("known_costs.csv")
PACKAGED_COLUMNS = ("object", "stage", "load", "cpu_s", "wall_s", "peak_memory_mb", "product_bytes")


NUMBERS = ("wall_seconds", "cpu_seconds", "peak_memory_mb")
MOST = 1e12  # of seconds or megabytes: above, it is no measurement


@dataclass(frozen=True)
class KnownCost:
    """What the task of an object and stage took when it last ran.

    Parameters
    ----------
    object_id, stage
        Whose task it was.
    wall_s, cpu_s
        Seconds; CPU seconds include child processes.
    memory_bytes
        Largest peak of all its runs: a peak of child processes is noted only where it exceeds those of
        earlier tasks in the same process, so a lower one may miss them.
    load
        What its cost goes with (see `pipeline.run.forecast.loads`); None where that is not known.
    product_bytes
        Size of all files it made; None where one is gone.
    """

    object_id: str
    stage: str
    wall_s: float
    cpu_s: float
    memory_bytes: int
    load: float | None = None
    product_bytes: int | None = None


def costs_of(root: Path) -> list[KnownCost]:
    """Return the known costs of a data set, the last run of each object and stage; sizes not looked up.

    What a kill cut short, or somebody else wrote there, counts as not there.
    """
    found: dict[tuple[str, str], KnownCost] = {}
    path = costs_path(root)
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8", errors="replace") as file:
        for object_id, stage, wall_s, cpu_s, peak_mb in _numbers(file):
            before = found.get((object_id, stage))
            peak = max(int(peak_mb * 1e6), before.memory_bytes if before else 0)
            found[object_id, stage] = KnownCost(object_id, stage, wall_s, cpu_s, peak)
    return list(found.values())


@cache
def packaged_costs() -> tuple[KnownCost, ...]:
    """Return the costs of the scans that the package was tried on."""
    with PACKAGED.open(newline="", encoding="utf-8") as file:
        return tuple(
            KnownCost(
                row["object"],
                row["stage"],
                float(row["wall_s"]),
                float(row["cpu_s"]),
                int(float(row["peak_memory_mb"]) * 1e6),
                float(row["load"]) if row["load"] else None,
                int(row["product_bytes"]) if row["product_bytes"] else None,
            )
            for row in csv.DictReader(file)
        )


def write_costs(costs: Iterable[KnownCost], path: Path) -> None:
    """Write a table as `packaged_costs` reads it."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(PACKAGED_COLUMNS)
        for cost in costs:
            load = "" if cost.load is None else f"{cost.load:.6g}"
            times = (round(cost.cpu_s, 2), round(cost.wall_s, 2), round(cost.memory_bytes / 1e6, 1))
            made = "" if cost.product_bytes is None else cost.product_bytes
            table.writerow((cost.object_id, cost.stage, load, *times, made))


def product_bytes(root: Path, stage: Stage, object_id: str) -> int | None:
    """Return the bytes of the products that a stage made of an object; None where one is missing."""
    try:
        return sum(path.stat().st_size for path in stage.targets(root, object_id))
    except OSError:
        return None


def _numbers(lines: Iterable[str]) -> Iterator[tuple[str, str, float, float, float]]:
    rows = _rows(lines)
    header = next(rows, [])
    if not set(COLUMNS[:6]) <= set(header):
        return
    places = [header.index(name) for name in NUMBERS]
    own, of_stage = header.index("object"), header.index("stage")
    for row in rows:
        if len(row) <= max(places) or row[of_stage] == QUERY:
            continue
        with contextlib.suppress(ValueError):
            wall_s, cpu_s, peak_mb = (float(row[place]) for place in places)
            if all(0 <= number < MOST for number in (wall_s, cpu_s, peak_mb)):
                yield row[own], row[of_stage], wall_s, cpu_s, peak_mb


def _rows(lines: Iterable[str]) -> Iterator[list[str]]:
    """Yield the rows up to one that is no CSV."""
    with contextlib.suppress(csv.Error):
        yield from csv.reader(lines)
