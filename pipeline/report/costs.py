"""Seconds and memory beside the data: read from a table, because products hold no timings."""

import csv
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from objectfolder.errors import InputError

STAGES = ("objects", "views", "modes", "touches", "encode", "fidelity")
QUERY = "query"


@dataclass(frozen=True)
class StageCost:
    """What one stage took for one object; None where it was not measured."""

    fingerprint: str
    cpu_seconds: float | None
    wall_seconds: float | None
    peak_memory_mb: float | None


@dataclass(frozen=True)
class Costs:
    """Costs by object: of the stages, and of one query at a setting of its effort."""

    stages: Mapping[tuple[str, str], list[StageCost]] = field(default_factory=dict)
    queries: Mapping[tuple[str, str], float] = field(default_factory=dict)

    def stage(self, object_id: str, stage: str, fingerprints: Mapping[str, str]) -> StageCost | None:
        """Return the cost of the product that is in use, the latest row where that is not known.

        Parameters
        ----------
        fingerprints
            Stage to the fingerprint of the product the fidelity was measured on.
        """
        rows = self.stages.get((object_id, stage), [])
        wanted = fingerprints.get(stage)
        if wanted is not None:
            rows = [row for row in rows if row.fingerprint == wanted]
        return rows[-1] if rows else None

    def stage_names(self, object_ids: Collection[str]) -> tuple[str, ...]:
        """Return the stages in order of the pipeline, others that these objects have behind them."""
        others = {stage for object_id, stage in self.stages if object_id in object_ids} - set(STAGES)
        return STAGES + tuple(sorted(others))

    def seconds_per_query(self, object_id: str, key: str) -> float | None:
        """Return the measured seconds of one query, None where they were not measured."""
        return self.queries.get((object_id, key))


def read_costs(path: Path) -> Costs:
    """Read the cost table; no file means that nothing was measured here.

    Columns: object, stage, fingerprint, cpu_seconds, wall_seconds, peak_memory_mb and, for rows of the
    stage ``query``, key (of a setting in the fidelity product) and seconds_per_query.

    Raises
    ------
    InputError
        A column is missing or a number is not one.
    """
    if not path.is_file():
        return Costs()
    stages: dict[tuple[str, str], list[StageCost]] = {}
    queries: dict[tuple[str, str], float] = {}
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        missing = {"object", "stage"} - set(reader.fieldnames or ())
        if missing and reader.fieldnames:
            raise InputError(str(path), f"no column {sorted(missing)}", "Delete it; a run measures again.")
        for row in reader:
            where = f"{path}, line {reader.line_num}"
            object_id, stage, fingerprint = row["object"], row["stage"], row.get("fingerprint") or ""
            if stage == QUERY:
                seconds = _number(row, "seconds_per_query", where)
                if seconds is not None:
                    queries[object_id, row.get("key") or fingerprint] = seconds
                continue
            cost = StageCost(
                fingerprint,
                _number(row, "cpu_seconds", where),
                _number(row, "wall_seconds", where),
                _number(row, "peak_memory_mb", where),
            )
            stages.setdefault((object_id, stage), []).append(cost)
    return Costs(stages, queries)


def _number(row: Mapping[str, str | None], column: str, where: str) -> float | None:
    text = (row.get(column) or "").strip()
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            where, f"{column} is {text!r}, not a number", "Delete the line; a run measures again."
        )
    return value
