"""Seconds and memory beside the data: read from a table, because products hold no timings."""

import csv
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from objectfolder.errors import InputError

STAGES = ("objects", "views", "modes", "touches", "encode", "fidelity")
QUERY = "query"
REMEDY = "Delete it; runs note costs anew."


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
    queries: Mapping[tuple[str, str], list[tuple[str, float]]] = field(default_factory=dict)

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

    def seconds_per_query(self, object_id: str, key: str, fingerprints: Mapping[str, str]) -> float | None:
        """Return the seconds of one query measured with the fidelity in use, None where there are none.

        Parameters
        ----------
        key
            Of a setting in the fidelity product.
        fingerprints
            As for `stage`.
        """
        wanted = fingerprints.get("fidelity")
        found = self.queries.get((object_id, key), [])
        seconds = [value for fingerprint, value in found if wanted in (None, fingerprint)]
        return seconds[-1] if seconds else None


def read_costs(path: Path) -> Costs:
    """Read the cost table; no file means that nothing was measured here.

    Columns: object, stage, fingerprint, cpu_seconds, wall_seconds, peak_memory_mb and, for rows of the
    stage ``query``, key (of a setting in the fidelity product) and seconds_per_query. A line that a kill
    cut short counts as not measured.

    Raises
    ------
    InputError
        A table without the columns object and stage, or no text at all.
    """
    if not path.is_file():
        return Costs()
    stages: dict[tuple[str, str], list[StageCost]] = {}
    queries: dict[tuple[str, str], list[tuple[str, float]]] = {}
    for row in _rows(path):
        object_id, stage, fingerprint = row["object"] or "", row["stage"] or "", row.get("fingerprint") or ""
        if stage == QUERY:
            seconds = _number(row, "seconds_per_query")
            if seconds is not None:
                queries.setdefault((object_id, row.get("key") or ""), []).append((fingerprint, seconds))
            continue
        cost = StageCost(
            fingerprint,
            _number(row, "cpu_seconds"),
            _number(row, "wall_seconds"),
            _number(row, "peak_memory_mb"),
        )
        stages.setdefault((object_id, stage), []).append(cost)
    return Costs(stages, queries)


def _rows(path: Path) -> list[dict[str, str | None]]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = {"object", "stage"} - set(reader.fieldnames or ())
            if missing and reader.fieldnames:
                raise InputError(
                    str(path),
                    f"no column {' and '.join(sorted(missing))}",
                    REMEDY,
                )
            return list(reader)
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(str(path), f"not a table ({error})", REMEDY) from error


def _number(row: Mapping[str, str | None], column: str) -> float | None:
    try:
        value = float(row.get(column) or "")
    except ValueError:
        return None
    return value if math.isfinite(value) and value >= 0 else None
